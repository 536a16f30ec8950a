//! Arbitrary calls of every service.

use super::values::Values;
use futures::{Stream, StreamExt as _, stream};
use lamina_rpc::v1::control_client::ControlClient;
use lamina_rpc::v1::diagnosis_client::DiagnosisClient;
use lamina_rpc::v1::frames_client::FramesClient;
use lamina_rpc::v1::ingest_client::IngestClient;
use lamina_rpc::v1::push_part::Part;
use lamina_rpc::v1::quality_client::QualityClient;
use lamina_rpc::v1::tuning_client::TuningClient;
use lamina_rpc::v1::{self, steering};
use std::collections::BTreeMap;
use std::time::Duration;
use tonic::transport::{Channel, Endpoint};
use tonic::{Response, Status, Streaming};

/// Messages of a stream are waited for so long.
const PATIENCE: Duration = Duration::from_millis(30);

/// Calls the three nodes.
pub(crate) struct Caller {
    urls: [String; 3],
    channels: [Channel; 3],
    calls: usize,
    /// Of the run that was opened last.
    run_id: String,
}

async fn channel(url: &str) -> Channel {
    Endpoint::from_shared(url.to_owned()).unwrap().connect().await.unwrap()
}

async fn channels(urls: &[String; 3]) -> [Channel; 3] {
    [channel(&urls[0]).await, channel(&urls[1]).await, channel(&urls[2]).await]
}

/// True if the first messages of `reply` come.
async fn first_of<T>(reply: Result<Response<Streaming<T>>, Status>) -> bool {
    let Ok(reply) = reply else { return false };
    let mut messages = reply.into_inner();
    matches!(tokio::time::timeout(PATIENCE, messages.message()).await, Ok(Ok(Some(_))))
}

/// All of `parts`, and then nothing for a while, as a peer that hangs.
fn stalled<T: Send + 'static>(parts: Vec<T>) -> impl Stream<Item = T> + Send + 'static {
    let wait = stream::once(async {
        tokio::time::sleep(2 * PATIENCE).await;
        None
    });
    stream::iter(parts).map(Some).chain(wait).filter_map(std::future::ready)
}

impl Caller {
    pub(crate) async fn connect(urls: &[String; 3]) -> Self {
        Self { urls: urls.clone(), channels: channels(urls).await, calls: 0, run_id: String::new() }
    }

    /// An arbitrary call; true if it is answered with more than an error.
    pub(crate) async fn call(&mut self, seed: u64) -> bool {
        // A connection has only so many calls a second.
        self.calls += 1;
        if self.calls.is_multiple_of(150) {
            self.channels = channels(&self.urls).await;
        }
        let mut values = Values::new(seed);
        let [generator, viz, tuner] = self.channels.clone();
        match values.below(13) {
            0 | 1 => self.open(generator, &mut values).await,
            2 | 3 => {
                let parts = (0..values.below(6)).map(|_| self.push_part(&mut values)).collect();
                first_of(IngestClient::new(generator).push(stalled(parts)).await).await
            }
            4 => {
                let request = v1::CloseRequest { run_id: self.run_of(&mut values), rank: values.small() };
                IngestClient::new(generator).close(request).await.is_ok()
            }
            5 => {
                let after_step = (!values.rarely(3)).then(|| values.number());
                let request = v1::SubscribeRequest { run_id: self.run_of(&mut values), after_step };
                first_of(FramesClient::new(generator).subscribe(request).await).await
            }
            6 => {
                let request = v1::SubscribeTrialsRequest { quality_address: values.word() };
                first_of(FramesClient::new(generator).subscribe_trials(request).await).await
            }
            7 => self.steer(generator, &mut values).await,
            8 => ControlClient::new(generator).set_parameters(setting(&mut values)).await.is_ok(),
            9 => {
                let requests = (0..values.below(4)).map(|_| trial(&mut values)).collect();
                first_of(ControlClient::new(generator).trials(stalled(requests)).await).await
            }
            10 => {
                let (trial_id, first_batch, batches) = (values.number(), values.small(), values.small());
                let request = v1::QualityRequest { trial_id, first_batch, batches, study: None };
                first_of(QualityClient::new(viz).measure(request).await).await
            }
            11 => {
                let status = v1::TunerStatus {
                    steps_seen: values.number(),
                    contract: values.word(),
                    last_error: values.word(),
                    chosen_psnr_db: Some(values.real()),
                    ..Default::default()
                };
                let update =
                    v1::TunerUpdate { status: Some(status), request_id: values.number(), refusal: values.word() };
                first_of(QualityClient::new(viz).negotiate(stalled(vec![update])).await).await
            }
            _ => {
                let request = v1::TunerStatusRequest { with_trials: values.rarely(2) };
                let told = TuningClient::new(tuner).status(request).await.is_ok();
                let reply_bytes = values.number() as u32;
                told && DiagnosisClient::new(generator).probe(v1::ProbeRequest { reply_bytes }).await.is_ok()
            }
        }
    }

    /// Parameters again with which any run is served.
    pub(crate) async fn reset(&mut self) {
        let params = lamina_model::GenerationParams::vdi(32, 0.02).unwrap();
        let request = v1::SetParametersRequest {
            params: Some((&params).into()),
            limits: Some(v1::Limits::default()),
            ..Default::default()
        };
        ControlClient::new(channel(&self.urls[0]).await).set_parameters(request).await.unwrap();
    }

    fn run_of(&self, values: &mut Values) -> String {
        if values.rarely(4) { values.word() } else { self.run_id.clone() }
    }

    async fn open(&mut self, generator: Channel, values: &mut Values) -> bool {
        let side = |values: &mut Values| if values.rarely(6) { values.number() } else { 8 };
        let unit = |values: &mut Values, usual: f64| if values.rarely(10) { values.real() } else { usual };
        let point = |values: &mut Values, usual: f64| {
            Some(v1::Vec3 { x: unit(values, usual), y: unit(values, usual), z: unit(values, usual) })
        };
        let grid = v1::Grid {
            nx: side(values),
            ny: side(values),
            nz: side(values),
            spacing: point(values, 1.0),
            origin: point(values, 0.0),
        };
        let axis = |values: &mut Values| {
            let first = unit(values, 0.0);
            let positions =
                (0..values.below(10)).map(|n| first + if values.rarely(10) { values.real() } else { n as f64 });
            v1::AxisCoordinates { positions: positions.collect() }
        };
        let axes = if values.rarely(3) { values.below(5) } else { 0 };
        let coordinates = (0..axes).map(|_| axis(values)).collect();
        let request = v1::OpenRequest {
            coordinates,
            name: if values.rarely(5) { values.word() } else { "hostile".to_owned() },
            field: if values.rarely(5) { values.word() } else { "density".to_owned() },
            grid: (!values.rarely(12)).then_some(grid),
            voxel_type: values.small() as i32,
            ranks: if values.rarely(5) { values.number() as u32 } else { 1 },
            rank: if values.rarely(5) { values.small() } else { 0 },
            full_policy: values.small() as i32,
            resume_run_id: if values.rarely(5) { values.word() } else { String::new() },
            shown: if values.rarely(5) { values.word() } else { String::new() },
            ..Default::default()
        };
        match IngestClient::new(generator).open(request).await {
            Ok(reply) => {
                self.run_id = reply.into_inner().run_id;
                true
            }
            Err(_) => false,
        }
    }

    fn push_part(&self, values: &mut Values) -> v1::PushPart {
        let part = match values.below(5) {
            0 | 1 => {
                let side = |values: &mut Values| if values.rarely(6) { values.number() } else { 8 };
                let start = |values: &mut Values| if values.rarely(6) { values.number() } else { 0 };
                Part::Header(v1::BrickHeader {
                    run_id: self.run_of(values),
                    step: values.number(),
                    time: values.real(),
                    rank: if values.rarely(5) { values.small() } else { 0 },
                    x0: start(values),
                    y0: start(values),
                    z0: start(values),
                    nx: side(values),
                    ny: side(values),
                    nz: side(values),
                    interval_ns: values.number(),
                    push_ns: values.number(),
                    brick: values.small(),
                    bricks: (!values.rarely(2)).then(|| values.small()),
                    diagnostics: diagnostics(values),
                })
            }
            2 => Part::Shared(v1::SharedBrick { ring: values.number(), slot: values.small() }),
            3 => Part::Chunk(values.bytes(64).into()),
            _ => Part::Chunk(vec![7; 8 * 8 * 8 * values.of(&[1, 2, 4, 8])].into()),
        };
        v1::PushPart { part: Some(part).filter(|_| !values.rarely(20)) }
    }

    async fn steer(&self, generator: Channel, values: &mut Values) -> bool {
        let mut frames = FramesClient::new(generator);
        let run_id = self.run_of(values);
        if values.rarely(2) {
            let number = v1::NewValue { name: values.word(), value: values.real() };
            let request = values.of(&[
                steering::Request::Command(0),
                steering::Request::Command(1),
                steering::Request::Command(99),
                steering::Request::Number(number),
            ]);
            let asked = v1::Steering { request: Some(request), asked_by: values.word() };
            return frames.steer(v1::SteerRequest { run_id, steering: Some(asked) }).await.is_ok();
        }
        let vector = |values: &mut Values| Some(v1::Vec3 { x: values.real(), y: values.real(), z: values.real() });
        let camera = v1::Camera {
            position: vector(values),
            target: vector(values),
            up: vector(values),
            fov_y_deg: values.real(),
        };
        let surface = v1::Isosurface { value: values.real(), opacity: Some(values.real()), ..Default::default() };
        let plane = v1::ClipPlane { normal: vector(values), offset: values.real() };
        let effects = v1::Effects {
            light: vector(values),
            shadows: Some(values.real()),
            isosurfaces: vec![surface; values.of(&[0, 1, 4, 5])],
            clip_planes: vec![plane],
            ..Default::default()
        };
        let request = v1::ShowRequest {
            run_id,
            field: values.rarely(2).then(|| values.word()),
            asked_by: values.word(),
            camera: values.rarely(2).then_some(camera),
            transfer: None,
            effects: values.rarely(2).then_some(effects),
        };
        frames.show(request).await.is_ok()
    }
}

fn params(values: &mut Values) -> v1::GenerationParams {
    // Of a size that a case has time for.
    let (resolution, gamma) = (values.of(&[0, 1, 8, 33, u32::MAX]), values.real());
    match lamina_model::GenerationParams::vdi(resolution.clamp(1, 33), 0.02) {
        Ok(good) if !values.rarely(3) => (&good).into(),
        _ => {
            let vdi = v1::generation_params::Vdi {
                resolution,
                gamma,
                opacity_cutoff: values.real(),
                step_voxels: values.real(),
            };
            v1::GenerationParams { kind: Some(v1::generation_params::Kind::Vdi(vdi)) }
        }
    }
}

fn setting(values: &mut Values) -> v1::SetParametersRequest {
    v1::SetParametersRequest {
        params: (!values.rarely(4)).then(|| params(values)),
        from_step: values.number(),
        limits: (!values.rarely(4)).then(v1::Limits::default),
        fallbacks: (0..values.below(3)).map(|_| params(values)).collect(),
        tuning_state: values.small() as i32,
        only_vdis: values.rarely(2),
        objective: values.small() as i32,
    }
}

fn trial(values: &mut Values) -> v1::TrialRequest {
    v1::TrialRequest {
        trial_id: values.number(),
        params: (!values.rarely(6)).then(|| params(values)),
        viewer: if values.rarely(2) { values.word() } else { String::new() },
        gammas: if values.rarely(4) { (0..values.below(5)).map(|_| values.real()).collect() } else { Vec::new() },
        time_alone: values.rarely(4),
        first_study: values.rarely(4),
    }
}

/// Names and values as nobody should tell them, now and then.
fn diagnostics(values: &mut Values) -> BTreeMap<String, f64> {
    let name = |values: &mut Values| values.of(&["residual", "", "a b", "=", "\u{0}", "n,1\n2"]).to_owned();
    if values.rarely(4) { [(name(values), values.real())].into() } else { BTreeMap::new() }
}
