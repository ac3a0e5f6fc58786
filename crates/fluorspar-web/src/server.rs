//! Requests and answers. Whatever takes time is done in a thread that answers nobody else.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use axum::body::Bytes;
use axum::extract::rejection::JsonRejection;
use axum::extract::{DefaultBodyLimit, Path as UrlPath, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use fluorspar::pipeline::PipelineError;
use fluorspar_report::page_policy;
use fluorspar_session::{Changes, Error, ErrorKind, LiveRender, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::controls::controls;
use crate::design::{DesignRequest, about_designs, design};
use crate::findings::{FindingsRequest, ReportRequest, findings, report};
use crate::guard::{Guard, guarded};
use crate::lane::Lane;
use crate::orbit::{OrbitRequest, orbit};
use crate::photograph::{EstimateRequest, PhotographRequest, Photographs, SaveRequest};
use crate::picture::{PictureRequest, picture, png_of};
use crate::region::{PartRequest, Place, RegionRequest, part_at, region};
use crate::subject::{Stage, Subject, check_no_files, read_ahead, said};

/// Largest request, bytes: changes and a polygon.
const MOST_BYTES: usize = 64 << 10;

/// Largest frame of a camera, and largest masks of all photographs, bytes.
const MOST_FRAME_BYTES: usize = 256 << 20;
const MOST_MASK_BYTES: usize = 32 << 20;

/// What all requests share.
pub(crate) struct Server {
    pub(crate) guard: Guard,
    pub(crate) subject: Arc<Subject>,
    is_read_ahead: AtomicBool,
    pub(crate) photographs: Arc<Photographs>,
    /// The page of the last report.
    report: Mutex<Option<Bytes>>,
    /// Pictures, estimates, what takes longer, and looks at renders: one of each is made at once.
    lanes: [Lane; 4],
}

impl Server {
    pub(crate) fn new(guard: Guard, subject: Subject, photographs: Photographs) -> Result<Self> {
        Ok(Self {
            guard,
            subject: Arc::new(subject),
            is_read_ahead: AtomicBool::new(false),
            photographs: Arc::new(photographs),
            report: Mutex::default(),
            lanes: [Lane::new()?, Lane::new()?, Lane::new()?, Lane::new()?],
        })
    }
}

type Shared = State<Arc<Server>>;
type Asked<T> = std::result::Result<Json<T>, JsonRejection>;

/// A page: path, kind and content.
type Page = (&'static str, &'static str, &'static str);

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const PAGES: [Page; 16] = [
    ("/", HTML, include_str!("../pages/index.html")),
    ("/style.css", "text/css; charset=utf-8", include_str!("../pages/style.css")),
    ("/icon.svg", "image/svg+xml", include_str!("../pages/icon.svg")),
    ("/main.js", SCRIPT, include_str!("../pages/main.js")),
    ("/anew.js", SCRIPT, include_str!("../pages/anew.js")),
    ("/changes.js", SCRIPT, include_str!("../pages/changes.js")),
    ("/compare.js", SCRIPT, include_str!("../pages/compare.js")),
    ("/designs.js", SCRIPT, include_str!("../pages/designs.js")),
    ("/findings.js", SCRIPT, include_str!("../pages/findings.js")),
    ("/photographs.js", SCRIPT, include_str!("../pages/photographs.js")),
    ("/controls.js", SCRIPT, include_str!("../pages/controls.js")),
    ("/orbit.js", SCRIPT, include_str!("../pages/orbit.js")),
    ("/picture.js", SCRIPT, include_str!("../pages/picture.js")),
    ("/tour.js", SCRIPT, include_str!("../pages/tour.js")),
    ("/region.js", SCRIPT, include_str!("../pages/region.js")),
    ("/chart.js", SCRIPT, include_str!("../pages/chart.js")),
];

pub(crate) fn router(server: Arc<Server>) -> Router {
    let mut router = Router::new()
        .route("/api/subject", get(subject))
        .route("/api/picture", post(picture_of))
        .route("/api/orbit", post(orbit_of))
        .route("/api/region", post(region_of))
        .route("/api/part", post(part_of))
        .route("/api/toml", post(toml_of))
        .route("/api/findings", post(findings_of))
        .route("/api/report", post(report_of))
        .route("/report.html", get(last_report))
        .route("/api/controls", post(controls_of))
        .route("/api/design", post(design_of))
        .route("/api/render", post(render))
        .route("/api/stop", post(stop))
        .route("/api/photographs", post(photographs))
        .route(
            "/api/photographs/file/{name}",
            post(photograph).layer(DefaultBodyLimit::max(MOST_FRAME_BYTES)),
        )
        .route("/api/photographs/picture", post(photograph_picture))
        .route(
            "/api/photographs/estimate",
            post(photograph_estimate).layer(DefaultBodyLimit::max(MOST_MASK_BYTES)),
        )
        .route("/api/photographs/save", post(photographs_save).layer(DefaultBodyLimit::max(MOST_MASK_BYTES)));
    for (path, kind, content) in PAGES {
        router = router.route(path, get(move || async move { ([(CONTENT_TYPE, kind)], content) }));
    }
    let guard = from_fn_with_state(Arc::clone(&server), guarded);
    router
        .fallback(|| async { refusal(StatusCode::NOT_FOUND, "there is nothing here") })
        .layer(DefaultBodyLimit::max(MOST_BYTES))
        .layer(guard)
        .with_state(server)
}

/// An error as the page reads it.
fn refusal(status: StatusCode, why: &str) -> Response {
    (status, Json(json!({ "error": why }))).into_response()
}

fn failure(error: &Error) -> Response {
    let status = match error.kind() {
        ErrorKind::Input => StatusCode::UNPROCESSABLE_ENTITY,
        ErrorKind::Failed | ErrorKind::Stopped => StatusCode::INTERNAL_SERVER_ERROR,
    };
    use PipelineError::{OtherCamera, OtherGrid, OtherLights, OtherScene, OutsideBasis};

    let needs_render = matches!(
        error,
        Error::Pipeline(
            OtherScene(_) | OtherCamera | OtherGrid { .. } | OtherLights { .. } | OutsideBasis(_)
        )
    );
    (status, Json(json!({ "error": said(error), "needs_render": needs_render }))).into_response()
}

/// The experiment with the changes that a request has, and the render that shows it.
pub(crate) struct Shown {
    pub(crate) first: Arc<LiveRender>,
    pub(crate) live: Arc<LiveRender>,
    pub(crate) changes: Changes,
}

/// A request on the experiment with changes, in the form of `--set`.
trait OfChanges: Send + 'static {
    fn set(&self) -> &[String];
}

macro_rules! of_changes {
    ($($request:ty),*) => {$(
        impl OfChanges for $request {
            fn set(&self) -> &[String] {
                &self.set
            }
        }
    )*};
}
of_changes!(
    PictureRequest,
    RegionRequest,
    PartRequest,
    FindingsRequest,
    ReportRequest,
    TomlRequest,
    OrbitRequest,
    ControlsRequest,
    RenderRequest
);

/// What work on a render gives, done in a thread of its own.
async fn answer<Q: OfChanges>(
    server: Arc<Server>,
    kind: Kind,
    asked: Asked<Q>,
    work: impl FnOnce(&Shown, &Q) -> Result<Response> + Send + 'static,
) -> Response {
    let Json(asked) = match asked {
        Ok(asked) => asked,
        Err(error) => return refusal(error.status(), &error.body_text()),
    };
    let first = match server.subject.stage() {
        Stage::Ready(live) => live,
        Stage::Rendering => return refusal(StatusCode::SERVICE_UNAVAILABLE, "the render is not there yet"),
        Stage::Failed(why) => return refusal(StatusCode::SERVICE_UNAVAILABLE, &why),
        Stage::Photographs | Stage::Designs(_) => {
            return refusal(StatusCode::SERVICE_UNAVAILABLE, "there is no render");
        }
    };
    let anew = Arc::clone(&server.subject.anew);
    in_turn(&server, kind, move || {
        let changes = Changes { set: asked.set().to_vec(), unset: Vec::new() };
        check_no_files(&changes)?;
        let live = anew.shown(&first, &changes);
        work(&Shown { first, live, changes }, &asked)
    })
    .await
}

/// What work on photographs gives, done in a thread of its own.
async fn answer_photographs<Q: Send + 'static>(
    server: Arc<Server>,
    kind: Kind,
    asked: Asked<Q>,
    work: impl FnOnce(&Photographs, &Q) -> Result<Response> + Send + 'static,
) -> Response {
    match asked {
        Ok(Json(asked)) => {
            let photographs = Arc::clone(&server.photographs);
            in_turn(&server, kind, move || work(&photographs, &asked)).await
        }
        Err(error) => refusal(error.status(), &error.body_text()),
    }
}

/// Kinds of work.
#[derive(Clone, Copy)]
enum Kind {
    Picture,
    Estimate,
    Report,
    Render,
}

/// Does work when its turn comes, in threads of its own; ends it where the browser takes its request back.
async fn in_turn(
    server: &Server,
    kind: Kind,
    work: impl FnOnce() -> Result<Response> + Send + 'static,
) -> Response {
    let done = server.lanes[kind as usize].run(move || work().unwrap_or_else(|error| failure(&error)));
    let defect = "this is a defect of Fluorspar: please report the last lines of the terminal";
    done.await.unwrap_or_else(|_| refusal(StatusCode::INTERNAL_SERVER_ERROR, defect))
}

/// How far the render is, and once it is there what it holds and what can be changed.
async fn subject(State(server): Shared) -> Response {
    let stage = server.subject.stage();
    let about = tokio::task::spawn_blocking(move || about(&server.subject, &stage)).await;
    match about {
        Ok(Ok(about)) => Json(about).into_response(),
        Ok(Err(error)) => failure(&error),
        Err(_) => refusal(StatusCode::INTERNAL_SERVER_ERROR, "this is a defect of Fluorspar"),
    }
}

fn about(subject: &Subject, stage: &Stage) -> Result<Value> {
    let name = &subject.name;
    let live = match stage {
        Stage::Ready(live) => live,
        Stage::Failed(why) => return Ok(json!({ "stage": "failed", "name": name, "error": why })),
        Stage::Photographs => return Ok(json!({ "stage": "photographs", "name": name })),
        Stage::Designs(found) => return Ok(about_designs(found)),
        Stage::Rendering => {
            let (share, said) = subject.progress();
            return Ok(json!({ "stage": "rendering", "name": name, "share": share, "said": said }));
        }
    };
    let experiment = live.experiment(&Changes::default())?;
    let file = &experiment.file;
    let captures: Vec<&str> = file.capture.iter().map(|capture| capture.name.as_str()).collect();
    let labels = live.render().labels();
    Ok(json!({
        "stage": "ready",
        "name": name,
        "title": file.title,
        "set": subject.changes(),
        "captures": captures,
        "analyzed": file.analysis.as_ref().map(|analysis| &analysis.frame),
        "parts": file.analysis.as_ref().map(|analysis| &analysis.place.parts),
        "render_px": [labels.width, labels.height],
        "samples_per_pixel": labels.samples_per_pixel,
        "groups": controls(live, &Changes::default())?,
    }))
}

/// A picture: the length of what is told beside it as four bytes, least first, that as JSON, and the PNG.
async fn picture_of(State(server): Shared, asked: Asked<PictureRequest>) -> Response {
    let shared = Arc::clone(&server);
    let work = move |shown: &Shown, asked: &PictureRequest| {
        let (facts, png) = picture(shown, asked)?;
        if !shown.live.is_coarse() && !shared.is_read_ahead.swap(true, Ordering::Relaxed) {
            read_ahead(&shown.live);
        }
        told_picture(&facts, &png)
    };
    answer(server, Kind::Picture, asked, work).await
}

fn told_picture(facts: &impl Serialize, png: &[u8]) -> Result<Response> {
    let facts = serde_json::to_vec(facts)?;
    let length = (facts.len() as u32).to_le_bytes();
    let body = Bytes::from([length.as_slice(), &facts, png].concat());
    Ok(([(CONTENT_TYPE, "application/octet-stream")], body).into_response())
}

/// Which experiment photographs belong to.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PhotographsRequest {
    experiment: Option<String>,
}

async fn photographs(State(server): Shared, asked: Asked<PhotographsRequest>) -> Response {
    let work = |photographs: &Photographs, asked: &PhotographsRequest| {
        Ok(Json(photographs.told(asked.experiment.as_deref())?).into_response())
    };
    answer_photographs(server, Kind::Picture, asked, work).await
}

async fn photograph(State(server): Shared, UrlPath(name): UrlPath<String>, bytes: Bytes) -> Response {
    let photographs = Arc::clone(&server.photographs);
    in_turn(&server, Kind::Picture, move || Ok(Json(photographs.take(&name, &bytes)?).into_response())).await
}

async fn photograph_picture(State(server): Shared, asked: Asked<PhotographRequest>) -> Response {
    let work = |photographs: &Photographs, asked: &PhotographRequest| {
        let (facts, shown) = photographs.picture(asked)?;
        told_picture(&facts, &png_of(&shown)?)
    };
    answer_photographs(server, Kind::Picture, asked, work).await
}

async fn photograph_estimate(State(server): Shared, asked: Asked<EstimateRequest>) -> Response {
    let work = |photographs: &Photographs, asked: &EstimateRequest| {
        Ok(Json(photographs.estimate(asked)?).into_response())
    };
    answer_photographs(server, Kind::Estimate, asked, work).await
}

async fn photographs_save(State(server): Shared, asked: Asked<SaveRequest>) -> Response {
    let work =
        |photographs: &Photographs, asked: &SaveRequest| Ok(Json(photographs.save(asked)?).into_response());
    answer_photographs(server, Kind::Picture, asked, work).await
}

/// What a report says of designs.
async fn design_of(State(server): Shared, asked: Asked<DesignRequest>) -> Response {
    match (server.subject.stage(), asked) {
        (_, Err(error)) => refusal(error.status(), &error.body_text()),
        (Stage::Designs(found), Ok(Json(asked))) => {
            in_turn(&server, Kind::Picture, move || design(&found, &asked)).await
        }
        _ => refusal(StatusCode::SERVICE_UNAVAILABLE, "there are no designs"),
    }
}

/// The shapes from any side, as [`picture_of`] sends pictures.
async fn orbit_of(State(server): Shared, asked: Asked<OrbitRequest>) -> Response {
    let work = |shown: &Shown, asked: &OrbitRequest| {
        let (facts, png) = orbit(shown, asked)?;
        told_picture(&facts, &png)
    };
    answer(server, Kind::Picture, asked, work).await
}

async fn region_of(State(server): Shared, asked: Asked<RegionRequest>) -> Response {
    let work = |shown: &Shown, asked: &RegionRequest| Ok(Json(region(shown, asked)?).into_response());
    answer(server, Kind::Estimate, asked, work).await
}

async fn findings_of(State(server): Shared, asked: Asked<FindingsRequest>) -> Response {
    let work = |shown: &Shown, asked: &FindingsRequest| Ok(Json(findings(shown, asked)?).into_response());
    answer(server, Kind::Report, asked, work).await
}

/// Makes the report that [`last_report`] shows.
async fn report_of(State(server): Shared, asked: Asked<ReportRequest>) -> Response {
    let shared = Arc::clone(&server);
    let work = move |shown: &Shown, asked: &ReportRequest| {
        let page = Bytes::from(report(shown, asked)?);
        *shared.report.lock().unwrap_or_else(PoisonError::into_inner) = Some(page);
        Ok(StatusCode::NO_CONTENT.into_response())
    };
    answer(server, Kind::Report, asked, work).await
}

async fn last_report(State(server): Shared) -> Response {
    match server.report.lock().unwrap_or_else(PoisonError::into_inner).clone() {
        Some(page) => {
            let policy = format!("{}; frame-ancestors 'none'", page_policy());
            ([(CONTENT_TYPE, HTML.to_owned()), (CONTENT_SECURITY_POLICY, policy)], page).into_response()
        }
        None => refusal(StatusCode::NOT_FOUND, "no report was made yet"),
    }
}

async fn part_of(State(server): Shared, asked: Asked<PartRequest>) -> Response {
    let work = |shown: &Shown, asked: &PartRequest| {
        Ok(Json(json!({ "part": part_at(shown, asked)? })).into_response())
    };
    answer(server, Kind::Picture, asked, work).await
}

/// Which changes are to be written into the experiment.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TomlRequest {
    #[serde(default)]
    set: Vec<String>,
    place: Option<Place>,
}

async fn toml_of(State(server): Shared, asked: Asked<TomlRequest>) -> Response {
    let work = |shown: &Shown, asked: &TomlRequest| {
        let place = asked.place.as_ref().map(Place::text);
        Ok(Json(json!({ "toml": shown.first.text_with(&shown.changes, place.as_deref())? })).into_response())
    };
    answer(server, Kind::Picture, asked, work).await
}

/// Of which changes the controls are wanted.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ControlsRequest {
    set: Vec<String>,
}

/// What can be changed of the render that shows the experiment with changes.
async fn controls_of(State(server): Shared, asked: Asked<ControlsRequest>) -> Response {
    let work =
        |shown: &Shown, _: &ControlsRequest| Ok(Json(controls(&shown.live, &shown.changes)?).into_response());
    answer(server, Kind::Picture, asked, work).await
}

/// Which changes are rendered, and how many pictures of them were seen; none where the render is to begin.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RenderRequest {
    set: Vec<String>,
    seen: Option<usize>,
}

/// Begins to render the experiment with changes, in place of what is in work; tells how far that is.
async fn render(State(server): Shared, asked: Asked<RenderRequest>) -> Response {
    let anew = Arc::clone(&server.subject.anew);
    let work = move |shown: &Shown, asked: &RenderRequest| {
        Ok(Json(anew.render(&shown.first, &shown.changes, asked.seen)?).into_response())
    };
    answer(server, Kind::Render, asked, work).await
}

/// Ends the render in work.
async fn stop(State(server): Shared) -> Response {
    server.subject.stop();
    StatusCode::ACCEPTED.into_response()
}
