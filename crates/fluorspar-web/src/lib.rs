//! The workbench: a local page on which frames and numbers follow lights, filters, sensors and concentrations. A front on
//! `fluorspar-session`: it parses requests and answers with pictures, numbers and words, and nothing of the physics is in its pages.
//!
//! | to | file |
//! |---|---|
//! | find what is shown: a run, a component image, an experiment that is rendered first, a search of designs | `subject.rs` |
//! | render what only a new render can show | `anew.rs` |
//! | tell the page what can be changed, with unit, range and path | `controls.rs` |
//! | draw a frame: developed, raw, where it clips, porphyrin | `picture.rs` |
//! | draw the shapes from any side | `orbit.rs` |
//! | say what the pixels of a region say | `region.rs` |
//! | say what a report says, and make it | `findings.rs` |
//! | show the designs of a search | `design.rs` |
//! | take photographs in, and save what was drawn on them | `photograph.rs` |
//! | answer requests | `server.rs` |
//! | end what nobody waits for any more | `lane.rs` |
//! | refuse those of others | `guard.rs` |
//! | the pages | `pages/` |

mod anew;
mod controls;
mod design;
mod findings;
mod guard;
mod lane;
mod orbit;
mod photograph;
mod picture;
mod region;
mod server;
mod subject;

use std::net::{Ipv4Addr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::ValueHint;
use fluorspar_format::read_described_frame;
use fluorspar_session::{Changes, Error, Result, values};

use crate::guard::Guard;
use crate::photograph::Photographs;
use crate::server::Server;
use crate::subject::{Subject, frames_of};

/// What the workbench shows, and where.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct WorkbenchOptions {
    /// Folder of a run or of a search of designs, component image (.exr, .npy), experiment (file or built-in name), which is rendered first,
    /// or raw frame of a camera (DNG, or TIFF or PNG with its description) [default: the built-in experiment].
    #[arg(value_name = "EXPERIMENT|FOLDER|COMPONENTS|FRAME", value_hint = ValueHint::AnyPath)]
    pub subject: Option<String>,
    /// Further raw frames.
    #[arg(value_name = "FRAMES", value_hint = ValueHint::FilePath)]
    pub frames: Vec<PathBuf>,
    /// Experiment that tells camera and lights of raw frames; the page can choose built-in ones.
    #[arg(long, value_name = "EXPERIMENT")]
    pub experiment: Option<String>,
    /// Changes on which the workbench begins.
    #[command(flatten)]
    pub changes: Changes,
    /// Samples (paths) per pixel of what is rendered for the page; few are soon there.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = values::whole::<u32, 1, 1_000_000>,
        allow_negative_numbers = true)]
    pub spp: u32,
    /// Port of this machine, 1 to 65535; the system chooses one by default.
    #[arg(long, value_name = "PORT", value_parser = values::whole::<u16, 1, 65_535>, allow_negative_numbers = true)]
    pub port: Option<u16>,
}

/// A workbench that listens on the loopback interface, and on no other.
pub struct Workbench {
    listener: TcpListener,
    server: Arc<Server>,
    address: String,
}

/// How often is looked whether the workbench shall end.
const LOOK: Duration = Duration::from_millis(50);
/// Longest wait for answers in the making at the end.
const LAST_ANSWERS: Duration = Duration::from_millis(300);

impl Workbench {
    /// Finds what is shown and takes a port. Nothing is answered before [`Self::run`].
    ///
    /// # Errors
    /// A run, image or experiment that can't be read, a change that can't be made, a port that is taken.
    pub fn open(options: &WorkbenchOptions) -> Result<Self> {
        let subject = Subject::find(options)?;
        let frames = frames_of(options);
        for frame in &frames {
            read_described_frame(frame)?;
        }
        let photographs = Photographs::new(&frames, options.experiment.clone())?;
        if !frames.is_empty() || options.experiment.is_some() {
            photographs.told(None)?;
        }
        let port = options.port.unwrap_or(0);
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(|error| {
            Error::Input(format!(
                "⟨port={port}⟩: can't listen on 127.0.0.1:{port}: {error}; give another port, or none for one that is free"
            ))
        })?;
        let found = listener.set_nonblocking(true).and_then(|()| listener.local_addr());
        let port = found.map_err(|error| Error::Failed(format!("can't listen: {error}")))?.port();
        let guard = Guard::new(port);
        let address = format!("http://127.0.0.1:{port}/?token={}", guard.token());
        Ok(Self { listener, server: Arc::new(Server::new(guard, subject, photographs)?), address })
    }

    /// The address with the token that opens the workbench.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Answers requests until `stop` is set; renders first where the subject is an experiment.
    ///
    /// # Errors
    /// A system that gives no threads.
    pub fn run(self, stop: &Arc<AtomicBool>) -> Result<()> {
        let Self { listener, server, .. } = self;
        server.subject.begin();
        let failed = |error: std::io::Error| Error::Failed(format!("can't serve: {error}"));
        let mut runtime = tokio::runtime::Builder::new_multi_thread();
        let runtime = runtime.worker_threads(2).enable_all().build().map_err(failed)?;
        let answering = runtime.spawn(async move {
            let listener = tokio::net::TcpListener::from_std(listener)?;
            axum::serve(listener, server::router(server)).await
        });
        runtime.block_on(async {
            while !stop.load(Ordering::SeqCst) && !answering.is_finished() {
                tokio::time::sleep(LOOK).await;
            }
        });
        runtime.shutdown_timeout(LAST_ANSWERS);
        Ok(())
    }
}
