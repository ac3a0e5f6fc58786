//! A workbench on a small render, and requests to it.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock};
use std::thread::{self, JoinHandle};

use fluorspar_experiment::Warning;
use fluorspar_session::{ExperimentArgs, Job, Left, Listener, RunOptions, run};
use fluorspar_web::{Workbench, WorkbenchOptions};
use serde_json::Value;
use tempfile::TempDir;

/// Hears nothing.
struct Silent;

impl Listener for Silent {
    fn status(&self, _: &str) {}

    fn warnings(&self, _: &[Warning]) {}

    fn begin(&self, _: &'static str, _: &'static str, _: Left) -> Box<dyn Fn(f64) + Sync> {
        Box::new(|_| {})
    }
}

pub(crate) fn job() -> Job {
    Job::new(Arc::default(), Arc::new(Silent))
}

/// A finished run of a patch under two lights, small enough for tests.
static RUN: LazyLock<(TempDir, PathBuf)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let set = ["render.width_px=32", "render.height_px=24", "sensor.columns=64", "sensor.rows=48"];
    let mut experiment = ExperimentArgs { experiment: Some("flat-patch".into()), ..Default::default() };
    experiment.changes.set = set.map(String::from).to_vec();
    experiment.render.spp = Some(4);
    run(&RunOptions { experiment, out: Some(out.clone()), ..Default::default() }, &job()).unwrap();
    (folder, out)
});

/// A run whose light can have another peak.
static ANY_LED: LazyLock<(TempDir, PathBuf)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("led");
    let set = [
        "render.width_px=16",
        "render.height_px=12",
        "sensor.columns=32",
        "sensor.rows=24",
        "spectral.first_nm=330",
        "render.excitation_basis_nm=[360.0, 480.0]",
    ];
    let mut experiment = ExperimentArgs { experiment: Some("flat-patch".into()), ..Default::default() };
    experiment.changes.set = set.map(String::from).to_vec();
    experiment.render.spp = Some(2);
    run(&RunOptions { experiment, out: Some(out.clone()), ..Default::default() }, &job()).unwrap();
    (folder, out)
});

/// The folder of that run.
pub(crate) fn any_led_folder() -> PathBuf {
    ANY_LED.1.clone()
}

/// The folder of the run.
pub(crate) fn run_folder() -> PathBuf {
    RUN.1.clone()
}

/// An answer.
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub(crate) fn json(&self) -> Value {
        assert_eq!(self.status, 200, "{}", self.text());
        serde_json::from_slice(&self.body).unwrap()
    }

    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        let pairs = self.head.lines().filter_map(|line| line.split_once(": "));
        pairs.filter(|(known, _)| known.eq_ignore_ascii_case(name)).map(|(_, value)| value).next()
    }
}

/// A workbench that answers until it is dropped.
pub(crate) struct Served {
    pub(crate) port: u16,
    pub(crate) token: String,
    pub(crate) cookie: String,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Served {
    /// On the finished run.
    pub(crate) fn on_run() -> Self {
        Self::on(&run_folder())
    }

    /// On the run of a folder.
    pub(crate) fn on(folder: &Path) -> Self {
        let subject = Some(folder.display().to_string());
        Self::of(&WorkbenchOptions { subject, spp: 1, ..Default::default() })
    }

    pub(crate) fn of(options: &WorkbenchOptions) -> Self {
        let workbench = Workbench::open(options).unwrap();
        let address = workbench.address().to_owned();
        let rest = address.strip_prefix("http://127.0.0.1:").unwrap();
        let (port, token) = rest.split_once("/?token=").unwrap();
        let stop: Arc<AtomicBool> = Arc::default();
        let until = Arc::clone(&stop);
        let thread = Some(thread::spawn(move || workbench.run(&until).unwrap()));
        let mut served =
            Self { port: port.parse().unwrap(), token: token.into(), cookie: String::new(), stop, thread };
        let welcome =
            served.send(&format!("GET /?token={token} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"), b"");
        let cookie = welcome.header("set-cookie").unwrap();
        served.cookie = cookie.split(';').next().unwrap().into();
        served
    }

    /// Sends lines of a head, each with its end, and a body.
    pub(crate) fn send(&self, head: &str, body: &[u8]) -> Answer {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let length =
            if body.is_empty() { String::new() } else { format!("Content-Length: {}\r\n", body.len()) };
        stream.write_all(format!("{head}{length}Connection: close\r\n\r\n").as_bytes()).unwrap();
        // A server that refuses a head need not read the body
        let _ = stream.write_all(body);
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
        let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Answer { status, head, body: bytes[end + 4..].to_vec() }
    }

    /// The head of a request as the page of the workbench makes it.
    pub(crate) fn head(&self, request: &str) -> String {
        let Self { port, cookie, .. } = self;
        format!("{request} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nCookie: {cookie}\r\n")
    }

    pub(crate) fn get(&self, path: &str) -> Answer {
        self.send(&self.head(&format!("GET {path}")), b"")
    }

    pub(crate) fn post(&self, path: &str, body: &Value) -> Answer {
        let head = format!("{}Content-Type: application/json\r\n", self.head(&format!("POST {path}")));
        self.send(&head, body.to_string().as_bytes())
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}
