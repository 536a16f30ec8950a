//! The services, used wrongly.

use crate::{LONG, Node, SIDE, STEP_BYTES, cube};
use lamina_model::GenerationParams;
use lamina_rpc::v1::generation_params::{Kind, Vdi, Volume as VolumeOf};
use lamina_rpc::v1::{self, control_client::ControlClient, ingest_client::IngestClient, push_part::Part};
use tokio::runtime::Runtime;
use tonic::codegen::tokio_stream::{self, Stream, StreamExt};
use tonic::transport::Channel;
use tonic::{Code, Status};

async fn within<T>(future: impl Future<Output = T>) -> T {
    tokio::time::timeout(LONG, future).await.expect("no answer")
}

fn refused<T: std::fmt::Debug>(result: Result<T, Status>, code: Code, word: &str) {
    let status = result.unwrap_err();
    assert_eq!(status.code(), code, "{status}");
    assert!(status.message().contains(word), "\"{}\" does not say \"{word}\"", status.message());
}

fn open_request() -> v1::OpenRequest {
    v1::OpenRequest {
        name: "raw".into(),
        grid: Some((&cube(SIDE)).into()),
        voxel_type: v1::VoxelType::F32.into(),
        ranks: 1,
        full_policy: v1::FullPolicy::Block.into(),
        ..Default::default()
    }
}

fn header(run_id: &str, step: u64) -> Part {
    let n = SIDE as u64;
    Part::Header(v1::BrickHeader { run_id: run_id.into(), step, nx: n, ny: n, nz: n, ..Default::default() })
}

fn chunk(bytes: usize) -> Part {
    Part::Chunk(vec![0; bytes].into())
}

fn parts(parts: impl IntoIterator<Item = Part, IntoIter: Send + 'static>) -> impl Stream<Item = v1::PushPart> + Send {
    tokio_stream::iter(parts.into_iter().map(|part| v1::PushPart { part: Some(part) }))
}

/// Sends a brick's messages; the admissions answered, or the refusal.
async fn push_raw(ingest: &mut IngestClient<Channel>, messages: Vec<Part>) -> Result<Vec<v1::Admission>, Status> {
    within(async {
        let mut answers = ingest.push(parts(messages)).await?.into_inner();
        let mut admissions = Vec::new();
        while let Some(answer) = answers.message().await? {
            admissions.push(answer.admission());
        }
        Ok(admissions)
    })
    .await
}

#[tokio::test]
async fn bricks_out_of_order_are_refused_and_leave_no_reservation() {
    let node = Node::generator(1);
    let mut ingest = IngestClient::new(node.channel().await);
    let run_id = ingest.open(open_request()).await.unwrap().into_inner().run_id;
    let header = || header(&run_id, 0);
    let half = || chunk(STEP_BYTES / 2);
    let wrong = [
        (vec![half()], "first message must be a brick header"),
        (vec![], "first message must be a brick header"),
        (vec![header(), chunk(STEP_BYTES + 1)], "more than the brick's 2048 bytes"),
        (vec![header(), half(), header()], "second header"),
        (vec![header(), half()], "ended after 1024 of 2048 bytes"),
        (vec![header(), half(), half(), half()], ""),
    ];
    let last = wrong.len() - 1;
    for (i, (messages, words)) in wrong.into_iter().enumerate() {
        let answers = push_raw(&mut ingest, messages).await;
        if i < last {
            refused(answers, Code::InvalidArgument, words);
        } else {
            // Room for one step, blocking: any reservation left over would make this wait for ever.
            assert_eq!(answers.unwrap(), [v1::Admission::Admitted; 2]);
        }
    }
}

#[test]
fn a_simulation_that_dies_half_way_leaves_no_reservation() {
    let node = Node::generator(1);
    let (dying, living) = (Runtime::new().unwrap(), Runtime::new().unwrap());
    let (run_id, _unread) = dying.block_on(async {
        let mut ingest = IngestClient::new(node.channel().await);
        let run_id = within(ingest.open(open_request())).await.unwrap().into_inner().run_id;
        let half = parts([header(&run_id, 0), chunk(STEP_BYTES / 2)]).chain(tokio_stream::pending());
        let mut answers = within(ingest.push(half)).await.unwrap().into_inner();
        assert_eq!(within(answers.message()).await.unwrap().unwrap().admission(), v1::Admission::Admitted);
        (run_id, answers)
    });
    dying.shutdown_timeout(LONG);
    let again = async {
        let mut ingest = IngestClient::new(node.channel().await);
        loop {
            // Until the node has noticed the death, its push is still under way.
            match push_raw(&mut ingest, vec![header(&run_id, 0), chunk(STEP_BYTES)]).await {
                Err(status) if status.code() == Code::AlreadyExists => tokio::task::yield_now().await,
                other => return other,
            }
        }
    };
    assert_eq!(living.block_on(async { within(again).await }).unwrap(), [v1::Admission::Admitted; 2]);
}

#[tokio::test]
async fn runs_that_cannot_be_are_refused() {
    let node = Node::generator(1);
    let mut ingest = IngestClient::new(node.channel().await);
    let grid = v1::Grid::from(&cube(SIDE));
    let wrong = [
        (v1::OpenRequest { ranks: 0, ..open_request() }, "ranks must be 1"),
        (v1::OpenRequest { rank: 1, ..open_request() }, "rank 1 of 1"),
        (v1::OpenRequest { name: String::new(), ..open_request() }, "name"),
        (v1::OpenRequest { grid: None, ..open_request() }, "grid"),
        (v1::OpenRequest { grid: Some(v1::Grid { ny: 0, ..grid }), ..open_request() }, "grid.dims"),
        (v1::OpenRequest { grid: Some(v1::Grid { nx: u64::MAX, ..grid }), ..open_request() }, "grid.dims"),
        (v1::OpenRequest { grid: Some(v1::Grid { spacing: None, ..grid }), ..open_request() }, "grid.spacing"),
        (v1::OpenRequest { voxel_type: 0, ..open_request() }, "voxel_type"),
        (v1::OpenRequest { voxel_type: 99, ..open_request() }, "voxel_type"),
        (v1::OpenRequest { resume_run_id: "../../etc".into(), ..open_request() }, "resume_run_id"),
    ];
    for (request, word) in wrong {
        refused(within(ingest.open(request)).await, Code::InvalidArgument, word);
    }
    let unknown = push_raw(&mut ingest, vec![header("nobody", 0)]).await;
    refused(unknown, Code::NotFound, "\"nobody\"");
    let close = v1::CloseRequest { run_id: "nobody".into(), rank: 0 };
    refused(within(ingest.close(close)).await, Code::NotFound, "\"nobody\"");
}

#[tokio::test]
async fn headers_that_cannot_be_are_refused() {
    let node = Node::generator(1);
    let mut ingest = IngestClient::new(node.channel().await);
    let run_id = ingest.open(open_request()).await.unwrap().into_inner().run_id;
    let n = SIDE as u64;
    let whole = v1::BrickHeader { run_id, nx: n, ny: n, nz: n, ..Default::default() };
    let wrong = [
        (v1::BrickHeader { time: f64::NAN, ..whole.clone() }, "time NaN must be finite"),
        (v1::BrickHeader { rank: 1, ..whole.clone() }, "rank 1"),
        (v1::BrickHeader { nz: 0, ..whole.clone() }, "brick"),
        (v1::BrickHeader { x0: u64::MAX, ..whole.clone() }, "brick"),
        (v1::BrickHeader { nx: n - 1, ..whole }, "cover 448 of 512 voxels"),
    ];
    for (header, word) in wrong {
        refused(push_raw(&mut ingest, vec![Part::Header(header)]).await, Code::InvalidArgument, word);
    }
}

#[tokio::test]
async fn parameters_that_cannot_be_are_refused_by_name() {
    let node = Node::generator(1);
    let mut control = ControlClient::new(node.channel().await);
    let vdi = Vdi { resolution: 8, gamma: 0.1, opacity_cutoff: 1.0, step_voxels: 0.5 };
    let volume = VolumeOf { longest_side: 8, error_bound: 0.1 };
    let good = v1::GenerationParams { kind: Some(Kind::Vdi(vdi)) };
    let wrong = [
        (Some(Kind::Vdi(Vdi { resolution: 0, ..vdi })), "resolution"),
        (Some(Kind::Vdi(Vdi { resolution: u32::MAX, ..vdi })), "resolution"),
        (Some(Kind::Vdi(Vdi { gamma: f64::NAN, ..vdi })), "gamma"),
        (Some(Kind::Vdi(Vdi { gamma: -0.1, ..vdi })), "gamma"),
        (Some(Kind::Vdi(Vdi { opacity_cutoff: 0.0, ..vdi })), "opacity_cutoff"),
        (Some(Kind::Vdi(Vdi { step_voxels: f64::INFINITY, ..vdi })), "step_voxels"),
        (Some(Kind::Volume(VolumeOf { longest_side: 0, ..volume })), "longest_side"),
        (Some(Kind::Volume(VolumeOf { error_bound: f64::NAN, ..volume })), "error_bound"),
        (None, "params.kind"),
    ];
    for (kind, name) in wrong {
        let params = v1::GenerationParams { kind };
        let request = v1::SetParametersRequest { params: Some(params), ..Default::default() };
        refused(within(control.set_parameters(request)).await, Code::InvalidArgument, name);
        let fallback = v1::SetParametersRequest { params: Some(good), fallbacks: vec![params], ..Default::default() };
        refused(within(control.set_parameters(fallback)).await, Code::InvalidArgument, name);
    }
    refused(within(control.set_parameters(v1::SetParametersRequest::default())).await, Code::InvalidArgument, "params");
    let request = v1::SetParametersRequest { params: Some(good), from_step: 3, ..Default::default() };
    let reply = within(control.set_parameters(request)).await.unwrap().into_inner();
    assert_eq!(reply.applies_from_step, 3);
    // Limits alone leave the parameters as they are.
    let limits = v1::Limits { size_bytes: Some(5000), ..Default::default() };
    let request = v1::SetParametersRequest { limits: Some(limits), ..Default::default() };
    within(control.set_parameters(request)).await.unwrap();
}

#[tokio::test]
async fn trials_need_a_step_a_number_and_parameters() {
    let node = Node::generator(1);
    let mut control = ControlClient::new(node.channel().await);
    let good = v1::GenerationParams::from(&GenerationParams::vdi(2, 0.5).unwrap());
    let ask = |trial_id, params| tokio_stream::iter([v1::TrialRequest { trial_id, params, ..Default::default() }]);
    refused(within(control.trials(ask(1, Some(good)))).await, Code::FailedPrecondition, "no step yet");

    let mut ingest = IngestClient::new(node.channel().await);
    let run_id = ingest.open(open_request()).await.unwrap().into_inner().run_id;
    push_raw(&mut ingest, vec![header(&run_id, 4), chunk(STEP_BYTES)]).await.unwrap();
    let mut reports = within(control.watch(v1::WatchRequest {})).await.unwrap().into_inner();
    let report = within(reports.message()).await.unwrap().unwrap();
    assert_eq!((report.step, report.run_id), (4, run_id));

    let bad = Vdi { resolution: 2, gamma: f64::NAN, opacity_cutoff: 1.0, step_voxels: 0.5 };
    let bad_gamma = Some(v1::GenerationParams { kind: Some(Kind::Vdi(bad)) });
    for (trial_id, params, word) in [(0, Some(good), "trial_id"), (1, None, "params"), (1, bad_gamma, "gamma")] {
        let mut answers = within(control.trials(ask(trial_id, params))).await.unwrap().into_inner();
        let greeting = within(answers.message()).await.unwrap().unwrap();
        assert_eq!((greeting.trial_id, greeting.step), (0, 4), "what is held is said before anything is asked");
        if trial_id == 0 {
            refused(within(answers.message()).await, Code::InvalidArgument, word);
        } else {
            let reply = within(answers.message()).await.unwrap().unwrap();
            assert!(reply.trial_id == 1 && reply.refusal.contains(word), "{}", reply.refusal);
        }
    }
}
