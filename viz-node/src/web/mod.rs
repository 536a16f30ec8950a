//! The page and what it asks for: state, events, pictures; and what metrics say of them.

pub(crate) mod assets;
pub(crate) mod guard;
pub(crate) mod metrics;
mod requests;

use crate::intake::Intake;
use crate::negotiation::{Negotiation, TunerSummary};
use crate::painter::{Orbit, PaintError, Painter};
use crate::steering::SteeringDesk;
use crate::store::{Event, Number, Run, StepRow, Store};
use crate::trials::StudyStatus;
use axum::extract::{Path, Query, State};
use axum::http::{StatusCode, header};
use axum::response::sse::{self, Sse};
use axum::response::{IntoResponse, Response};
use axum::{
    Extension, Json, Router,
    routing::{get, post},
};
use futures::{Stream, StreamExt};
use guard::Rights;
use lamina_compute::{Activity, Priority};
use lamina_model::{Appearance, Steerable, TransferFunction};
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Timeline, Trace};
use lamina_vdi_render::Detail;
use serde::{Deserialize, Serialize};
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::TryRecvError;

/// What the handlers share.
#[derive(Clone)]
pub(crate) struct Web {
    pub store: Arc<Store>,
    pub painter: Arc<Painter>,
    pub intake: Arc<Intake>,
    pub negotiation: Arc<Negotiation>,
    pub steering: Arc<SteeringDesk>,
    /// The subscription to live steps stands.
    pub connected: Arc<AtomicBool>,
}

impl Web {
    /// All routes.
    pub(crate) fn router(self) -> Router {
        Router::new()
            .merge(assets::router())
            .route("/api/state", get(state))
            .route("/api/trials", get(trials))
            .route("/api/events", get(events))
            .route("/api/contract", post(requests::contract))
            .route("/api/steer", post(requests::steer))
            .route("/api/show", post(requests::show))
            .route("/api/trigger", post(requests::trigger))
            .route("/api/runs", get(runs))
            .route("/api/runs/{run}", get(run_steps))
            .route("/api/step/{step}", get(step))
            .route("/api/image", get(image))
            .route("/api/transfer", get(transfer))
            .with_state(self)
            .layer(axum::middleware::map_response(assets::guarded))
    }
}

#[derive(Serialize)]
struct ShownLimit {
    size_bytes: Option<u64>,
    time_ms: Option<f64>,
}

#[derive(Serialize)]
struct PageState {
    run: Option<Run>,
    limit: ShownLimit,
    steps: Vec<StepRow>,
    missed_steps: u64,
    connected: bool,
    study: Option<StudyState>,
    tuner: Option<TunerSummary>,
    may_steer: bool,
    steerable: Steerable,
}

/// How far the newest study is that asks here.
#[derive(Serialize)]
struct StudyState {
    /// The step it is of.
    step: u64,
    /// The run's first.
    first: bool,
    /// Trials begun.
    trials: u32,
    /// Of the best trial that keeps the contract so far.
    best_psnr_db: Option<Number>,
    best_size_bytes: u64,
}

impl From<StudyStatus> for StudyState {
    fn from(status: StudyStatus) -> Self {
        let StudyStatus { step, first, trials, best_psnr_db, best_size_bytes } = status;
        Self { step, first, trials, best_psnr_db: best_psnr_db.map(Number::from), best_size_bytes }
    }
}

/// Most steps that a page is given when it opens: what a plot can show, and a few megabytes.
const SHOWN_STEPS: usize = 8192;

/// Of many steps the newest half of [`SHOWN_STEPS`], and of those before evenly as many.
fn thinned<T>(rows: Vec<T>) -> Vec<T> {
    if rows.len() <= SHOWN_STEPS {
        return rows;
    }
    let older = rows.len() - SHOWN_STEPS / 2;
    let every = older.div_ceil(SHOWN_STEPS / 2);
    rows.into_iter().enumerate().filter(|(n, _)| *n >= older || n.is_multiple_of(every)).map(|(_, row)| row).collect()
}

async fn state(State(web): State<Web>, Extension(rights): Extension<Rights>) -> Json<PageState> {
    let steps = thinned(web.store.rows());
    let last = steps.last();
    let limit =
        ShownLimit { size_bytes: last.and_then(|r| r.size_limit_bytes), time_ms: last.and_then(|r| r.time_limit_ms) };
    let missed_steps = last.map_or(0, |r| r.dropped_steps);
    let connected = web.connected.load(std::sync::atomic::Ordering::Relaxed);
    let study = web.intake.trials.study().map(StudyState::from);
    let tuner = web.negotiation.tuner();
    let may_steer = rights == Rights::Steer;
    Json(PageState {
        run: web.store.run(),
        limit,
        missed_steps,
        connected,
        study,
        tuner,
        may_steer,
        steerable: web.steering.steerable(),
        steps,
    })
}

/// What the tuner's trials of this run came to here.
async fn trials(State(web): State<Web>) -> Json<Vec<StepRow>> {
    Json(web.store.run().map_or_else(Vec::new, |run| web.intake.trials.rows(&run.id)))
}

async fn events(State(web): State<Web>) -> Sse<impl Stream<Item = Result<sse::Event, Infallible>>> {
    let events = web.store.events();
    let to_sse = move |event| {
        let (name, data) = match &event {
            Event::Run(run) => ("run", serde_json::to_string(run)),
            Event::Step(_, row) => ("step", serde_json::to_string(row)),
            Event::Tuner => ("tuner", serde_json::to_string(&web.negotiation.tuner())),
            Event::Steerable => ("steerable", serde_json::to_string(&web.steering.steerable())),
            Event::Trial => ("trial", serde_json::to_string(&web.intake.trials.study().map(StudyState::from))),
        };
        Ok(sse::Event::default().event(name).data(data.unwrap_or_default()))
    };
    // A page that fell behind fetches the state anew when the next run or step comes.
    Sse::new(events.map(to_sse)).keep_alive(sse::KeepAlive::default())
}

/// The runs recorded beside the current one.
async fn runs(State(web): State<Web>) -> Response {
    match web.store.earlier_runs() {
        Ok(runs) => Json(runs).into_response(),
        Err(e) => (StatusCode::INTERNAL_SERVER_ERROR, e.to_string()).into_response(),
    }
}

/// One of them, and when its steps were.
#[derive(Serialize)]
struct RunSteps {
    run: Run,
    steps: Vec<StepTime>,
}

#[derive(Serialize)]
struct StepTime {
    step: u64,
    /// Of the simulation.
    time: f64,
}

async fn run_steps(State(web): State<Web>, Path(run): Path<String>) -> Response {
    match web.store.earlier_run(&run) {
        Ok(run) => {
            let steps = run.rows().map(|row| StepTime { step: row.step, time: row.time }).collect();
            Json(RunSteps { run: run.run().clone(), steps }).into_response()
        }
        Err(e) => (StatusCode::NOT_FOUND, e.to_string()).into_response(),
    }
}

/// The encoded bytes of a step, with those it was coded after: pages decode and draw it themselves.
async fn step(State(web): State<Web>, Path(step): Path<u64>, Query(query): Query<StepQuery>) -> Response {
    let mut timeline = Timeline::begin();
    let current = web.store.run().map(|run| run.id);
    let trace = Trace::of_step(Role::Viewer, query.run.as_ref().or(current.as_ref()).map_or("", |run| run), step);
    let bytes = match query.run.filter(|run| Some(run) != current.as_ref()) {
        Some(run) => web.store.earlier_run(&run).and_then(|run| run.self_contained(step)),
        None if query.alone => web.store.encoded(step),
        None => web.store.self_contained(step),
    };
    match bytes {
        Ok(bytes) => {
            let headers = [(header::CONTENT_TYPE, "application/octet-stream"), (header::CACHE_CONTROL, "no-store")];
            timeline.lap("give to a page", [("lamina.size_bytes", (bytes.len() as i64).into())]);
            timeline.send(trace);
            (headers, bytes.to_vec()).into_response()
        }
        Err(e) => (StatusCode::NOT_FOUND, e.to_string()).into_response(),
    }
}

#[derive(Deserialize)]
struct StepQuery {
    /// Of the current run, or one recorded beside it; the current one's where it is not said.
    run: Option<String>,
    /// Without those it was coded after, which the page holds.
    #[serde(default)]
    alone: bool,
}

#[derive(Deserialize)]
struct ImageQuery {
    step: String,
    /// An [`Appearance`], JSON.
    appearance: Option<String>,
    #[serde(default)]
    azimuth: f64,
    #[serde(default)]
    elevation: f64,
    #[serde(default = "one")]
    zoom: f64,
    #[serde(default = "default_size")]
    size: u32,
    /// Drawn fast rather than well, for pictures in motion.
    #[serde(default)]
    draft: bool,
}

/// What a volume is seen under, for the page's editor.
#[derive(Serialize)]
struct ShownTransfer {
    #[serde(flatten)]
    function: TransferFunction,
    /// Positions 0..1 whose values were not recorded, since nothing shows there.
    unrecorded: Vec<[f32; 2]>,
}

#[derive(Deserialize)]
struct TransferQuery {
    step: u64,
}

async fn transfer(State(web): State<Web>, Query(query): Query<TransferQuery>) -> Response {
    let permit = web.intake.share.acquire(Priority::Picture).await;
    match permit.run(Activity::Decode, move |_| web.store.prepared(query.step)).await {
        Ok(Ok(shown)) => match shown.transfer() {
            Some(function) => {
                let parts = function.transparent_parts().into_iter();
                let unrecorded = parts.map(|part| part.map(|end| end.clamp(0.0, 1.0))).collect();
                Json(ShownTransfer { function: function.clone(), unrecorded }).into_response()
            }
            None => (StatusCode::BAD_REQUEST, "a VDI holds colors, not values").into_response(),
        },
        Ok(Err(e)) => (StatusCode::NOT_FOUND, e.to_string()).into_response(),
        Err(e) => (StatusCode::INTERNAL_SERVER_ERROR, e.to_string()).into_response(),
    }
}

/// Pictures that may wait at once: one for each of so many pages.
const MOST_WAITING: usize = 64;

fn one() -> f64 {
    1.0
}
fn default_size() -> u32 {
    512
}

async fn image(State(web): State<Web>, Query(query): Query<ImageQuery>) -> Response {
    let step = match query.step.as_str() {
        "newest" => web.store.newest_step(),
        number => match number.parse() {
            Ok(step) => Some(step),
            Err(_) => return (StatusCode::BAD_REQUEST, "step: a number, or newest").into_response(),
        },
    };
    let Some(step) = step else { return (StatusCode::NOT_FOUND, "no step yet").into_response() };
    let (zoom, size) = (query.zoom, query.size);
    let detail = if query.draft { Detail::Nearest } else { Detail::Cubic };
    let orbit = Orbit { azimuth_deg: query.azimuth, elevation_deg: query.elevation, zoom, size, detail };
    let appearance = match query.appearance.as_deref().map(serde_json::from_str::<Appearance>).transpose() {
        Ok(appearance) => appearance,
        Err(e) => return (StatusCode::BAD_REQUEST, format!("appearance: {e}")).into_response(),
    };
    if web.intake.share.waiting() > MOST_WAITING {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many pictures are waited for; ask again later").into_response();
    }
    let permit = web.intake.share.acquire(Priority::Picture).await;
    // Whoever closes the connection, as a page does when the picture is turned, drops this and wants no more.
    let (waiting, wanted) = std::sync::mpsc::channel::<Infallible>();
    let work =
        move |_: &mut _| web.painter.picture(step, orbit, appearance, || wanted.try_recv() == Err(TryRecvError::Empty));
    let done = permit.run(Activity::Draw, work).await;
    drop(waiting);
    match done {
        Ok(Ok(None)) => StatusCode::SERVICE_UNAVAILABLE.into_response(),
        Ok(Ok(Some(p))) => {
            let millis = format!("{:.1}", p.render_time.as_secs_f64() * 1e3);
            let headers = [
                ("content-type", "image/png".to_owned()),
                ("cache-control", "no-store".to_owned()),
                ("x-lamina-step", p.step.to_string()),
                ("x-lamina-render-ms", millis),
            ];
            (headers, p.png).into_response()
        }
        Ok(Err(PaintError::Invalid(e))) => (StatusCode::BAD_REQUEST, e.to_string()).into_response(),
        Ok(Err(PaintError::Store(e))) => (StatusCode::NOT_FOUND, e.to_string()).into_response(),
        Err(e) => (StatusCode::INTERNAL_SERVER_ERROR, e.to_string()).into_response(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_steps_a_page_is_given_the_newest_and_some_of_each_time_before() {
        assert_eq!(thinned((0..SHOWN_STEPS).collect::<Vec<_>>()).len(), SHOWN_STEPS);
        for count in [SHOWN_STEPS + 1, 20_000, 1_000_000] {
            let shown = thinned((0..count).collect::<Vec<_>>());
            assert!(shown.len() <= SHOWN_STEPS, "{} of {count}", shown.len());
            assert_eq!(shown[0], 0);
            assert!(shown.iter().rev().zip((0..count).rev()).take(SHOWN_STEPS / 2).all(|(a, b)| *a == b));
            let gaps: Vec<usize> = shown.windows(2).map(|w| w[1] - w[0]).collect();
            assert!(gaps.iter().all(|gap| *gap <= count.div_ceil(SHOWN_STEPS / 2)), "{count}");
        }
    }
}
