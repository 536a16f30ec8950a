//! What crosses the wire before admission: a node that records it.

use crate::{LONG, Node, SIDE, STEP_BYTES, VOXELS, admitted, any_port, options, push_whole};
use lamina_client::{Brick, Client, ClientError, Receipt, RunOptions, Summary};
use lamina_rpc::daemon::{Access, serve_grpc};
use lamina_rpc::v1::{self, push_part::Part};
use std::future::pending;
use std::sync::{Arc, mpsc};
use std::time::Duration;
use tonic::codegen::tokio_stream::wrappers::ReceiverStream;
use tonic::service::Routes;
use tonic::{Request, Response, Status, Streaming};

/// The node goes without every other step.
const CADENCE: u32 = 2;

#[derive(Clone, Copy)]
enum Verdict {
    Admit,
    Drop,
    Silence,
}

/// Gives every brick the same verdict and tells its step and how many bytes were sent of it.
struct Recorder {
    verdict: Verdict,
    seen: mpsc::Sender<(u64, usize)>,
}

impl Recorder {
    fn start(verdict: Verdict) -> (Node, mpsc::Receiver<(u64, usize)>) {
        let (seen, records) = mpsc::channel();
        let service = v1::ingest_server::IngestServer::new(Self { verdict, seen });
        let (routes, metrics) = (Routes::new(service), Arc::new(|_: &mut _| {}));
        let node = Node::serve(any_port(), |listener| async {
            serve_grpc(routes, metrics, listener, Access::SameUser, Box::pin(pending())).await.unwrap();
        });
        (node, records)
    }
}

async fn record(
    verdict: Verdict,
    mut parts: Streaming<v1::PushPart>,
    answers: tokio::sync::mpsc::Sender<Result<v1::PushAnswer, Status>>,
) -> (u64, usize) {
    let (mut step, mut bytes) = (0, 0);
    let answer = |admission: v1::Admission| {
        Ok(v1::PushAnswer { admission: admission.into(), step_complete: true, cadence: CADENCE })
    };
    // The answers stay open until the client hangs up, so that nothing it sends is missed.
    while let Ok(Some(v1::PushPart { part: Some(part) })) = parts.message().await {
        match part {
            Part::Header(header) => step = header.step,
            Part::Chunk(chunk) => bytes += chunk.len(),
            // None was offered.
            Part::Shared(_) => return (0, 0),
        }
        let _ = match verdict {
            Verdict::Admit => answers.send(answer(v1::Admission::Admitted)).await,
            Verdict::Drop => answers.send(answer(v1::Admission::Dropped)).await,
            Verdict::Silence => Ok(()),
        };
    }
    (step, bytes)
}

#[tonic::async_trait]
impl v1::ingest_server::Ingest for Recorder {
    type PushStream = ReceiverStream<Result<v1::PushAnswer, Status>>;

    async fn open(&self, _: Request<v1::OpenRequest>) -> Result<Response<v1::OpenReply>, Status> {
        Ok(Response::new(v1::OpenReply { run_id: "recorded".into(), chunk_bytes: 4096, ..Default::default() }))
    }

    async fn push(&self, request: Request<Streaming<v1::PushPart>>) -> Result<Response<Self::PushStream>, Status> {
        let (answers, stream) = tokio::sync::mpsc::channel(4);
        let (verdict, seen) = (self.verdict, self.seen.clone());
        tokio::spawn(async move {
            let _ = seen.send(record(verdict, request.into_inner(), answers).await);
        });
        Ok(Response::new(ReceiverStream::new(stream)))
    }

    async fn close(&self, _: Request<v1::CloseRequest>) -> Result<Response<v1::CloseReply>, Status> {
        Ok(Response::new(v1::CloseReply { dropped_steps: 0 }))
    }

    type SteeringStream = ReceiverStream<Result<v1::Steering, Status>>;

    async fn steering(&self, _: Request<v1::SteeringSubscription>) -> Result<Response<Self::SteeringStream>, Status> {
        Err(Status::unimplemented("an older node"))
    }
}

#[test]
fn a_brick_that_is_not_admitted_is_never_sent() {
    for (verdict, sent) in [(Verdict::Admit, STEP_BYTES), (Verdict::Drop, 0), (Verdict::Silence, 0)] {
        let (node, records) = Recorder::start(verdict);
        // Silence ends by the deadline only; the others must not be hurried.
        let deadline = if matches!(verdict, Verdict::Silence) { Duration::from_secs(2) } else { LONG };
        let mut client = Client::connect(RunOptions { deadline, ..options(&node.url()) }).unwrap();
        let pushed = push_whole(&mut client, 3);
        match verdict {
            Verdict::Admit => assert_eq!(pushed.unwrap(), admitted(true)),
            Verdict::Drop => assert_eq!(pushed.unwrap(), Receipt::Dropped),
            Verdict::Silence => assert!(matches!(pushed, Err(ClientError::Deadline(_))), "{pushed:?}"),
        }
        client.close();
        assert_eq!(records.recv_timeout(LONG).unwrap(), (3, sent));
    }
}

#[test]
fn a_step_that_the_node_goes_without_is_not_wanted_and_never_sent() {
    let (node, records) = Recorder::start(Verdict::Admit);
    let mut client = Client::connect(options(&node.url())).unwrap();
    assert!(client.wants(1).unwrap(), "the node has not said so yet");
    assert_eq!(push_whole(&mut client, 1).unwrap(), admitted(true));
    assert_eq!([2, 3, 4].map(|step| client.wants(step).unwrap()), [false, false, true]);
    assert_eq!(push_whole(&mut client, 4).unwrap(), admitted(true));
    assert_eq!(push_whole(&mut client, 5).unwrap(), Receipt::Dropped);
    assert_eq!(push_whole(&mut client, 6).unwrap(), admitted(true));
    assert_eq!(client.close(), Summary { pushed: 3, dropped: 3, lost: 0, run_dropped_steps: Some(0) });
    let heard: Vec<u64> = (0..3).map(|_| records.recv_timeout(LONG).unwrap().0).collect();
    assert_eq!(heard, [1, 4, 6]);
}

#[test]
fn bricks_of_the_wrong_type_or_length_are_refused_before_anything_is_sent() {
    let (node, records) = Recorder::start(Verdict::Admit);
    let mut client = Client::connect(options(&node.url())).unwrap();
    let (doubles, short) = (vec![0.0_f64; VOXELS], vec![0.0_f32; VOXELS - 1]);
    let right = vec![0.0_f32; VOXELS];
    let wrong = [
        (Brick::new([0; 3], [SIDE; 3], &right).with_colors(&doubles), "options do not name"),
        (Brick::new([0; 3], [SIDE; 3], &doubles), "float64 voxels of density; the run has float32"),
        (Brick::new([0; 3], [SIDE; 3], &short), "511 voxels of density for a box of [8, 8, 8]"),
        (Brick::new([0; 3], [0, SIDE, SIDE], &short[..0]), "a box of [0, 8, 8]"),
    ];
    for (step, (brick, words)) in wrong.into_iter().enumerate() {
        match client.push(step as u64, 0.0, &brick) {
            Err(ClientError::Invalid(e)) => assert!(e.thing == "brick" && e.reason.contains(words), "{e}"),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(push_whole(&mut client, 9).unwrap(), admitted(true));
    assert_eq!(client.close(), Summary { pushed: 1, dropped: 0, lost: 4, run_dropped_steps: Some(0) });
    assert_eq!(records.recv_timeout(LONG).unwrap(), (9, STEP_BYTES), "the first that the node heard of");
}
