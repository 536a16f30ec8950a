//! The ingest service: the state machine behind a lock, and waiting where the run's policy is to block.

use super::brick::BrickBytes;
use super::{Admit, BrickOffer, CompleteStep, Core, IngestError, IngestFigures, Remarks, RunSpec};
use crate::overhead::Overhead;
use crate::steering::SteeringRelay;
use futures::{Stream, StreamExt};
use lamina_field_expression::ShownFields;
use lamina_model::{Diagnostics, Invalid, Scene};
use lamina_rpc::v1::{self, ingest_server, push_part::Part};
use lamina_rpc::{chunks::CHUNK_BYTES, invalid, required};
use lamina_shared_memory::{KEPT_SLOTS, Rings, SharedBytes};
use parking_lot::{Mutex, MutexGuard};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tokio::sync::{Notify, mpsc};
use tonic::{Code, Request, Response, Status, Streaming};

/// Ingest state shared by all connections and the cycle.
#[derive(Debug)]
pub struct Ingest {
    core: Mutex<Core>,
    /// How runs that do not say are shown.
    default_scene: Option<Scene>,
    pub(super) overhead: Arc<Overhead>,
    pub(super) room: Notify,
    pub(super) ready: Notify,
    shared: Option<SharedMemory>,
    steering: Arc<SteeringRelay>,
    /// No brick is taken any more.
    stopping: AtomicBool,
    /// Members of the group that this node is of, and, of its root, the door to them.
    members: u32,
    door: Option<Arc<dyn AssignMember>>,
}

/// Chooses which member of a group takes the bricks of a rank.
pub trait AssignMember: std::fmt::Debug + Send + Sync {
    /// The member's address for `rank` of a run, on the host named `host`; empty for this node itself.
    fn assign(&self, run_id: &str, spec: &RunSpec, rank: u32, host: &str) -> String;
}

/// Memory that simulations on this host share with the node.
#[derive(Debug)]
pub struct SharedMemory {
    /// The socket through which it comes.
    pub name: String,
    /// What has come.
    pub rings: Arc<Rings>,
}

impl Ingest {
    /// Empty state.
    pub fn new(
        memory_bytes: u64,
        waiting_steps: usize,
        idle: Duration,
        default_scene: Option<Scene>,
        overhead: Arc<Overhead>,
        shared: Option<SharedMemory>,
    ) -> Self {
        let core = Mutex::new(Core::new(memory_bytes, waiting_steps, idle));
        Self {
            core,
            default_scene,
            overhead,
            room: Notify::new(),
            ready: Notify::new(),
            shared,
            steering: Arc::default(),
            stopping: AtomicBool::new(false),
            members: 1,
            door: None,
        }
    }

    /// The same of a node of a group of `members`; `door` is the root's.
    #[must_use]
    pub(crate) fn of_group(self, members: u32, door: Option<Arc<dyn AssignMember>>) -> Self {
        Self { members, door, ..self }
    }

    /// Takes no more bricks: what is whole is worked off before the node ends.
    pub(crate) fn stop(&self) {
        self.stopping.store(true, Ordering::Relaxed);
    }

    /// What viz-nodes ask the simulation for.
    pub(crate) fn steering(&self) -> &Arc<SteeringRelay> {
        &self.steering
    }

    /// Another field of the run that `spec` describes is to be shown.
    ///
    /// # Errors
    /// If there is not the memory that this takes.
    pub(crate) fn show(&self, spec: &RunSpec, shown: &ShownFields) -> Result<(), IngestError> {
        self.core().show(spec, shown)
    }

    /// The state; a panic elsewhere leaves it whole, because no method of it panics between two changes.
    pub(super) fn core(&self) -> MutexGuard<'_, Core> {
        self.core.lock()
    }

    /// Waits until there is a complete step.
    pub async fn complete(&self) {
        loop {
            let ready = self.ready.notified();
            if self.core().has_complete() {
                return;
            }
            ready.await;
        }
    }

    /// Other limits from now on, as of [`Ingest::new`].
    pub(crate) fn set_limits(&self, memory_bytes: u64, waiting_steps: usize, idle: Duration) {
        self.core().set_limits(memory_bytes, waiting_steps, idle);
        self.room.notify_waiters();
    }

    /// How much has come and waits.
    pub(crate) fn figures(&self) -> IngestFigures {
        self.core().figures()
    }

    /// True if the run's policy is to let the simulation wait.
    pub(crate) fn blocks(&self) -> bool {
        self.core().blocks()
    }

    /// The next complete step.
    pub fn take(&self) -> Option<CompleteStep> {
        let step = self.core().take_complete(Instant::now());
        self.room.notify_waiters();
        step
    }

    /// Decides on a brick; waits where the run blocks.
    async fn admit(&self, h: &v1::BrickHeader) -> Result<Option<usize>, IngestError> {
        let (start, dims) = ([h.x0, h.y0, h.z0], [h.nx, h.ny, h.nz]);
        let (index, bricks) = (h.brick, h.bricks.unwrap_or(1));
        let offer = BrickOffer { step: h.step, time: h.time, rank: h.rank, index, bricks, start, dims };
        loop {
            let room = self.room.notified();
            tokio::pin!(room);
            room.as_mut().enable();
            let admitted = self.core().admit(&h.run_id, &offer, Instant::now());
            if !matches!(admitted, Ok(Admit::Wait)) {
                // Deciding may have dropped other steps.
                self.room.notify_waiters();
            }
            if self.core().has_complete() {
                // Or completed them.
                self.ready.notify_one();
            }
            match admitted? {
                Admit::Granted(bytes) => return Ok(Some(bytes)),
                Admit::Dropped => return Ok(None),
                // Looks again now and then: what is waited for may be a rank that is lost.
                Admit::Wait => drop(tokio::time::timeout(WHILE_WAITING, room).await),
            }
        }
    }
}

/// Pause before a rank that waits for room asks again.
const WHILE_WAITING: Duration = Duration::from_secs(1);

/// A granted reservation: given back if its bytes never come.
struct Reservation<'a> {
    ingest: &'a Ingest,
    header: &'a v1::BrickHeader,
    filled: bool,
}

impl Drop for Reservation<'_> {
    fn drop(&mut self) {
        if !self.filled {
            let v1::BrickHeader { run_id, step, rank, brick, .. } = self.header;
            self.ingest.core().abort(run_id, *step, (*rank, *brick));
            self.ingest.room.notify_waiters();
        }
    }
}

/// The gRPC face of [`Ingest`].
#[derive(Debug)]
pub struct IngestService(pub Arc<Ingest>);

fn answer(admission: v1::Admission, step_complete: bool, cadence: u32) -> v1::PushAnswer {
    v1::PushAnswer { admission: admission.into(), step_complete, cadence }
}

/// Receives one brick: header, admission, bytes, receipt.
async fn take_brick(
    ingest: &Ingest,
    mut parts: Streaming<v1::PushPart>,
    answers: &mpsc::Sender<Result<v1::PushAnswer, Status>>,
) -> Result<(), Status> {
    let Some(v1::PushPart { part: Some(Part::Header(header)) }) = parts.message().await? else {
        return Err(Status::invalid_argument("push: the first message must be a brick header"));
    };
    if ingest.stopping.load(Ordering::Relaxed) {
        return Err(Status::unavailable("this generator-node is stopping"));
    }
    let leads = header.rank == 0 && header.brick == 0;
    let times = if leads { [header.interval_ns, header.push_ns] } else { [0; 2] };
    let remarks = Remarks::new(header.diagnostics.clone(), times).map_err(IngestError::from)?;
    if let Some([interval, push]) = remarks.pace {
        ingest.overhead.step(interval, push);
    }
    let admitted = tokio::select! {
        admitted = ingest.admit(&header) => admitted?,
        () = answers.closed() => return Ok(()),
    };
    let cadence = ingest.cadence();
    let Some(expected) = admitted else {
        let _ = answers.send(Ok(answer(v1::Admission::Dropped, false, cadence))).await;
        return Ok(());
    };
    let mut reservation = Reservation { ingest, header: &header, filled: false };
    if !ingest.core().remark(&header.run_id, header.step, &remarks) {
        tracing::warn!(step = header.step, "more than {} diagnostics; some are left out", Diagnostics::MOST);
    }
    let _ = answers.send(Ok(answer(v1::Admission::Admitted, false, cadence))).await;
    let bytes = take_bytes(ingest, &mut parts, expected).await?;
    reservation.filled = true;
    let received =
        ingest.core().receive(&header.run_id, header.step, (header.rank, header.brick), bytes, Instant::now())?;
    ingest.ready.notify_one();
    ingest.room.notify_waiters();
    let admission = if received.is_some() { v1::Admission::Admitted } else { v1::Admission::Dropped };
    let _ = answers.send(Ok(answer(admission, received == Some(true), cadence))).await;
    Ok(())
}

/// The `expected` bytes of a brick: in chunks, or where the simulation wrote them.
async fn take_bytes(
    ingest: &Ingest,
    parts: &mut Streaming<v1::PushPart>,
    expected: usize,
) -> Result<BrickBytes, Status> {
    let mut bytes = Vec::new();
    while bytes.len() < expected {
        let Some(part) = parts.message().await? else {
            let have = bytes.len();
            return Err(Status::invalid_argument(format!("push: the brick ended after {have} of {expected} bytes")));
        };
        match part.part {
            Some(Part::Chunk(chunk)) if bytes.len() + chunk.len() <= expected => {
                bytes.reserve_exact(expected - bytes.len());
                bytes.extend_from_slice(&chunk);
            }
            Some(Part::Chunk(_)) => {
                return Err(Status::invalid_argument(format!(
                    "push: more than the brick's {expected} bytes were sent"
                )));
            }
            Some(Part::Shared(v1::SharedBrick { ring, slot })) if bytes.is_empty() => {
                let shared = ingest.shared.as_ref().and_then(|memory| memory.rings.take(ring, slot, expected));
                let missing =
                    || Status::invalid_argument(format!("push: slot {slot} of ring {ring} was not handed over"));
                return keep(shared.ok_or_else(missing)?).await;
            }
            _ => return Err(Status::invalid_argument("push: a second header before the brick's bytes were all in")),
        }
    }
    Ok(bytes.into())
}

/// Keeps the bytes where they are, or copies them where so many are kept that the simulation would run out of slots.
async fn keep(bytes: SharedBytes) -> Result<BrickBytes, Status> {
    if bytes.kept_slots() <= KEPT_SLOTS {
        return Ok(BrickBytes::Shared(bytes));
    }
    let copied = tokio::task::spawn_blocking(move || bytes.to_vec()).await;
    copied.map(BrickBytes::Own).map_err(|e| Status::internal(e.to_string()))
}

impl From<IngestError> for Status {
    fn from(error: IngestError) -> Self {
        let code = match &error {
            IngestError::Refused(_) => Code::InvalidArgument,
            IngestError::Repeated { .. } => Code::AlreadyExists,
            IngestError::Conflict(_) => Code::FailedPrecondition,
            IngestError::Exhausted { .. } => Code::ResourceExhausted,
            IngestError::UnknownRun(_) => Code::NotFound,
        };
        Self::new(code, error.to_string())
    }
}

#[tonic::async_trait]
impl ingest_server::Ingest for IngestService {
    async fn open(&self, request: Request<v1::OpenRequest>) -> Result<Response<v1::OpenReply>, Status> {
        let request = request.into_inner();
        let mut spec = spec_from(&request).map_err(|e| invalid(&e))?;
        spec.scene = spec.scene.or_else(|| self.0.default_scene.clone());
        spec.members = self.0.members;
        let fresh = fresh_run_id(&spec.name);
        let resume = check_run_id(&request.resume_run_id)?;
        let spec_of_run = spec.clone();
        let is_sent_by_the_root = spec.members > 1 && self.0.door.is_none() && !resume.is_empty();
        let run_id = if is_sent_by_the_root {
            self.0.announced(resume).await;
            self.0.core().join(spec, request.rank, resume, Instant::now())?
        } else {
            self.0.core().open(spec, request.rank, resume, fresh, Instant::now())?
        };
        self.0.room.notify_waiters();
        let member = match &self.0.door {
            Some(door) => door.assign(&run_id, &spec_of_run, request.rank, &request.host),
            None => String::new(),
        };
        let resampled = spec_of_run.coordinates.is_some();
        tracing::info!(run_id, rank = request.rank, member, resampled, "rank attached");
        let shared_memory = self.0.shared.as_ref().map(|memory| memory.name.clone()).unwrap_or_default();
        Ok(Response::new(v1::OpenReply { run_id, chunk_bytes: CHUNK_BYTES as u32, shared_memory, member }))
    }

    type PushStream = Pin<Box<dyn Stream<Item = Result<v1::PushAnswer, Status>> + Send>>;

    async fn push(&self, request: Request<Streaming<v1::PushPart>>) -> Result<Response<Self::PushStream>, Status> {
        let ingest = self.0.clone();
        let (answers, stream) = mpsc::channel(2);
        tokio::spawn(async move {
            if let Err(refusal) = take_brick(&ingest, request.into_inner(), &answers).await {
                tracing::warn!(reason = refusal.message(), "brick refused");
                let _ = answers.send(Err(refusal)).await;
            }
        });
        Ok(Response::new(tokio_stream::wrappers::ReceiverStream::new(stream).boxed()))
    }

    async fn close(&self, request: Request<v1::CloseRequest>) -> Result<Response<v1::CloseReply>, Status> {
        let v1::CloseRequest { run_id, rank } = request.into_inner();
        let dropped_steps = self.0.core().close(&run_id, rank, Instant::now())?;
        self.0.room.notify_waiters();
        tracing::info!(run_id, rank, dropped_steps, "rank detached");
        Ok(Response::new(v1::CloseReply { dropped_steps }))
    }

    type SteeringStream = Pin<Box<dyn Stream<Item = Result<v1::Steering, Status>> + Send>>;

    async fn steering(
        &self,
        request: Request<v1::SteeringSubscription>,
    ) -> Result<Response<Self::SteeringStream>, Status> {
        let v1::SteeringSubscription { run_id, numbers } = request.into_inner();
        self.0.core().run(&run_id)?;
        let numbers = lamina_rpc::steering::numbers(numbers).map_err(|e| invalid(&e))?;
        tracing::info!(run_id, numbers = numbers.len(), "the simulation can be steered");
        let listening = self.0.steering.listen(run_id, numbers);
        Ok(Response::new(listening.map(|steering| Ok(steering.into())).boxed()))
    }
}

fn spec_from(r: &v1::OpenRequest) -> Result<RunSpec, Invalid> {
    let grid = required(r.grid, "grid")?.try_into()?;
    Ok(RunSpec {
        name: r.name.clone(),
        field: r.field.clone(),
        grid,
        coordinates: lamina_rpc::convert::axes_of(r.coordinates.clone(), &grid)?,
        voxel_type: r.voxel_type().try_into()?,
        color_field: r.color_field.as_ref().map(TryInto::try_into).transpose()?,
        more_fields: r.more_fields.iter().map(TryInto::try_into).collect::<Result<_, _>>()?,
        shown: Some(r.shown.clone()).filter(|shown| !shown.is_empty()),
        ranks: r.ranks,
        full_policy: r.full_policy().into(),
        scene: r.scene.clone().map(TryInto::try_into).transpose()?,
        members: 1,
    })
}

/// Name and time: sorts by age, unique per machine and run, and safe as a folder's name.
fn fresh_run_id(name: &str) -> String {
    let safe: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '_' }).collect();
    // Two starts may share a millisecond, and their steps must not mix.
    let micros = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_micros());
    format!("{}-{micros}", &safe[..safe.len().min(80)])
}

fn check_run_id(id: &str) -> Result<&str, Status> {
    let safe = id.len() <= 120 && id.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
    if safe { Ok(id) } else { Err(Status::invalid_argument("resume_run_id: not an id that a generator-node gave")) }
}
