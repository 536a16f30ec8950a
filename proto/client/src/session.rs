//! One connection with an open run.

use crate::pace::Timing;
use crate::{Brick, Receipt, RunOptions};
use lamina_model::{Diagnostics, Invalid};
use lamina_rpc::connect::{channel, endpoint, innermost};
use lamina_rpc::credentials::{Credentials, Role};
use lamina_rpc::v1::{self, ingest_client::IngestClient, push_part::Part};
use lamina_shared_memory::{Lease, Ring};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Channel, Endpoint};
use tonic::{Status, Streaming};

/// One of the bricks that a rank has of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StepPart<'a> {
    /// The step.
    pub step: u64,
    /// Simulation time.
    pub time: f64,
    /// Which one, from 0.
    pub index: u32,
    /// How many.
    pub bricks: u32,
    /// What is told of the step.
    pub diagnostics: &'a Diagnostics,
}

/// The longest that connecting may take, where the deadline of a call is longer.
const CONNECT_WITHIN: Duration = Duration::from_secs(2);

/// An attached rank.
#[derive(Debug)]
pub(crate) struct Session {
    ingest: IngestClient<Channel>,
    chunk_bytes: usize,
    /// Where the node is on this host.
    ring: Option<Ring>,
}

impl Session {
    /// Connects and attaches; `run_id` is the one had before, or empty. Gives the run's id. Of a group of nodes it is the root that is
    /// asked first, and the member it names that takes the bricks.
    pub(crate) async fn open(
        options: RunOptions,
        credentials: Option<Credentials>,
        run_id: String,
    ) -> Result<(Self, String), Status> {
        // With the credentials' files as they are now.
        let to = |address: &str| {
            let unusable = |e: Invalid| Status::unavailable(e.to_string());
            let endpoint = endpoint(address, Role::Generator, credentials.as_ref()).map_err(unusable)?;
            Ok::<_, Status>(endpoint.connect_timeout(options.deadline.min(CONNECT_WITHIN)))
        };
        let (session, run_id, member) = Self::attach(to(&options.generator)?, options.clone(), run_id).await?;
        if member.is_empty() {
            return Ok((session, run_id));
        }
        let (session, run_id, _) = Self::attach(to(&member)?, options, run_id).await?;
        Ok((session, run_id))
    }

    /// One node's part of it; also the member that it names in its place.
    async fn attach(endpoint: Endpoint, options: RunOptions, run_id: String) -> Result<(Self, String, String), Status> {
        // A stuck node is noticed while a blocking push waits, however long its deadline.
        let endpoint =
            endpoint.http2_keep_alive_interval(Duration::from_secs(5)).keep_alive_timeout(Duration::from_secs(10));
        let channel = channel(endpoint).await.map_err(|e| Status::unavailable(innermost(&e)))?;
        let mut ingest = IngestClient::new(channel);
        let host = lamina_rpc::connect::host_name();
        let request = v1::OpenRequest {
            host,
            name: options.name,
            field: options.field,
            grid: Some((&options.grid).into()),
            voxel_type: v1::VoxelType::from(options.voxel_type).into(),
            ranks: options.ranks,
            rank: options.rank,
            full_policy: v1::FullPolicy::from(options.full_policy).into(),
            scene: options.scene.as_ref().map(Into::into),
            resume_run_id: run_id,
            color_field: options.color_field.as_ref().map(Into::into),
            more_fields: options.more_fields.iter().map(Into::into).collect(),
            shown: options.shown.unwrap_or_default(),
            coordinates: lamina_rpc::convert::axes_message(options.coordinates.as_ref()),
        };
        let reply = ingest.open(request).await?.into_inner();
        let chunk_bytes = (reply.chunk_bytes as usize).clamp(1 << 12, lamina_rpc::MAX_MESSAGE_BYTES / 2);
        let ring = match reply.shared_memory {
            name if name.is_empty() || !reply.member.is_empty() => None,
            name => connect_ring(name).await,
        };
        Ok((Self { ingest, chunk_bytes, ring }, reply.run_id, reply.member))
    }

    /// True if there is a ring.
    pub(crate) fn shares_memory(&self) -> bool {
        self.ring.is_some()
    }

    /// Memory for `bytes` that the node maps, too; `None` if it is on another host, or keeps all there is.
    pub(crate) fn lease(&mut self, bytes: usize) -> Option<Lease> {
        match self.ring.as_mut()?.lease(bytes) {
            Ok(lease) => lease,
            Err(error) => {
                tracing::warn!(%error, "no shared memory; bricks go through the connection");
                self.ring = None;
                None
            }
        }
    }

    /// Announces the brick, waits for its admission, hands its bytes over, waits for the receipt; and the cadence that the node
    /// wants. The bytes lie in `lease` already if there is one.
    pub(crate) async fn push(
        &mut self,
        run_id: &str,
        rank: u32,
        part_of: StepPart<'_>,
        timing: Timing,
        brick: &Brick<'_>,
        lease: Option<&Lease>,
    ) -> Result<(Receipt, u32), Status> {
        let StepPart { step, time, index, bricks, diagnostics } = part_of;
        let [x0, y0, z0] = brick.start.map(|v| v as u64);
        let [nx, ny, nz] = brick.dims.map(|v| v as u64);
        let [interval_ns, push_ns] = [timing.interval, timing.push].map(|t| t.as_nanos() as u64);
        let run_id = run_id.to_owned();
        let header = v1::BrickHeader {
            run_id,
            step,
            time,
            rank,
            x0,
            y0,
            z0,
            nx,
            ny,
            nz,
            interval_ns,
            push_ns,
            brick: index,
            bricks: Some(bricks),
            diagnostics: diagnostics.clone().into(),
        };
        let (parts, stream) = mpsc::channel(2);
        let hung_up = || Status::unavailable("the connection ended");
        let part = |part| v1::PushPart { part: Some(part) };
        parts.send(part(Part::Header(header))).await.map_err(|_| hung_up())?;
        let mut answers = self.ingest.clone().push(ReceiverStream::new(stream)).await?.into_inner();
        let admission = next(&mut answers).await?;
        if admission.admission() == v1::Admission::Dropped {
            return Ok((Receipt::Dropped, admission.cadence));
        }
        if bricks == 0 {
            let receipt = next(&mut answers).await?;
            return Ok((receipt_of(&receipt), receipt.cadence));
        }
        let filled = lease.filter(|lease| self.ring.as_ref().is_some_and(|ring| lease.is_of(ring)));
        let copied = if filled.is_none() { self.copied(brick) } else { None };
        let shared = filled.or(copied.as_ref());
        if let Some(lease) = shared {
            lease.hand_over();
            let _ = parts.send(part(Part::Shared(v1::SharedBrick { ring: lease.ring(), slot: lease.slot() }))).await;
        } else {
            for chunk in brick.chunks(self.chunk_bytes) {
                if parts.send(part(Part::Chunk(chunk.into()))).await.is_err() {
                    // The node has hung up; its last answer says why.
                    break;
                }
            }
        }
        let receipt = next(&mut answers).await.inspect_err(|_| {
            // Whether the node has taken what was handed over is not known.
            if shared.is_some() {
                self.ring = None;
            }
        })?;
        Ok((receipt_of(&receipt), receipt.cadence))
    }

    /// The brick's bytes in memory that the node maps, too.
    fn copied(&mut self, brick: &Brick<'_>) -> Option<Lease> {
        let mut lease = self.lease(brick.size_bytes())?;
        brick.copy_to(lease.bytes_mut());
        Some(lease)
    }

    /// Detaches the rank; gives the number of the run's steps that were dropped.
    pub(crate) async fn close(mut self, run_id: &str, rank: u32) -> Result<u64, Status> {
        let reply = self.ingest.close(v1::CloseRequest { run_id: run_id.to_owned(), rank }).await?;
        Ok(reply.into_inner().dropped_steps)
    }
}

fn receipt_of(answer: &v1::PushAnswer) -> Receipt {
    match answer.admission() {
        v1::Admission::Dropped => Receipt::Dropped,
        _ => Receipt::Admitted(answer.step_complete),
    }
}

/// The ring at `name`; `None` if the node that offers it is on another host.
async fn connect_ring(name: String) -> Option<Ring> {
    let connected = tokio::task::spawn_blocking(move || Ring::connect(&name)).await.ok()?;
    connected.inspect_err(|reason| tracing::debug!(%reason, "no shared memory with this generator-node")).ok()
}

async fn next(answers: &mut Streaming<v1::PushAnswer>) -> Result<v1::PushAnswer, Status> {
    answers.message().await?.ok_or_else(|| Status::unavailable("the connection ended before the receipt"))
}
