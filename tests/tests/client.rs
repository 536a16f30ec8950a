//! The real client against a real generator-node: what a simulation meets when all is well, and when nothing is.
//!
//! Also the ingest and control services themselves, used wrongly on purpose. What a VDI contains is no matter here.

#![allow(clippy::unwrap_used)]

use glam::DVec3;
use lamina_cast::Backend;
use lamina_client::{Brick, Client, ClientError, FullPolicy, Receipt, RunOptions, Summary};
use lamina_generator_node::Config;
use lamina_model::suggest::suggest;
use lamina_model::{ColorField, Effects, GenerationParams, Grid, ScalarRange, Scale, Scene, Volume, VoxelType, Voxels};
use lamina_wire::v1::{self, control_client::ControlClient, ingest_client::IngestClient, push_part::Part};
use std::future::{Future, pending};
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::mpsc;
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;
use tonic::codegen::tokio_stream::{self, Stream, StreamExt, wrappers::ReceiverStream};
use tonic::transport::Channel;
use tonic::{Code, Request, Response, Status, Streaming};

const SIDE: usize = 8;
const VOXELS: usize = SIDE * SIDE * SIDE;
const STEP_BYTES: usize = 4 * VOXELS;
/// Far more than anything here takes on a loaded machine; met only by a hang.
const LONG: Duration = Duration::from_secs(60);
/// A push that waits for nothing takes microseconds.
const IMMEDIATE: Duration = Duration::from_millis(50);

// ---- A node in this process, and the client's side of it.

/// A server with a runtime of its own, so that dropping it is a kill.
struct Node {
    runtime: Option<Runtime>,
    address: SocketAddr,
}

impl Node {
    fn serve<F>(address: SocketAddr, server: impl FnOnce(tokio::net::TcpListener) -> F) -> Self
    where
        F: Future<Output = ()> + Send + 'static,
    {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
        let listener = TcpListener::bind(address).unwrap();
        listener.set_nonblocking(true).unwrap();
        let address = listener.local_addr().unwrap();
        let guard = runtime.enter();
        runtime.spawn(server(tokio::net::TcpListener::from_std(listener).unwrap()));
        drop(guard);
        Self { runtime: Some(runtime), address }
    }

    fn generator_at(address: SocketAddr, waiting: usize) -> Self {
        let working = 2 * STEP_BYTES + 12 * VOXELS;
        let config = Config {
            memory_bytes: (working + waiting * STEP_BYTES) as u64,
            params: GenerationParams::new(2, 0.5).unwrap(),
            reference_every: 0,
            ..Config::default()
        };
        Self::serve(address, |listener| async {
            lamina_generator_node::run(config, Backend::cpu(), listener, Box::pin(pending())).await.unwrap();
        })
    }

    /// A generator-node with memory for `waiting` steps.
    fn generator(waiting: usize) -> Self {
        Self::generator_at(any_port(), waiting)
    }

    fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    async fn channel(&self) -> Channel {
        Channel::from_shared(self.url()).unwrap().connect().await.unwrap()
    }

    /// Stops all at once, as a crash would; the address is free afterwards.
    fn kill(mut self) -> SocketAddr {
        self.runtime.take().unwrap().shutdown_timeout(LONG);
        self.address
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

fn any_port() -> SocketAddr {
    (Ipv4Addr::LOCALHOST, 0).into()
}

/// A socket that holds its address and does not listen: connections are refused, and no other test gets the address.
fn dead_socket() -> tokio::net::TcpSocket {
    let socket = tokio::net::TcpSocket::new_v4().unwrap();
    socket.bind(any_port()).unwrap();
    socket
}

fn cube(side: usize) -> Grid {
    Grid::new([side; 3], DVec3::ONE, DVec3::ZERO).unwrap()
}

fn options(url: &str) -> RunOptions {
    RunOptions { deadline: LONG, ..RunOptions::new(url, "blast", "density", cube(SIDE), VoxelType::F32) }
}

fn rank_of(url: &str, rank: u32, ranks: u32, full_policy: FullPolicy) -> RunOptions {
    RunOptions { rank, ranks, full_policy, ..options(url) }
}

fn push_planes(client: &mut Client, step: u64, z0: usize, nz: usize) -> Result<Receipt, ClientError> {
    let voxels: Vec<f32> = (0..SIDE * SIDE * nz).map(|i| i as f32).collect();
    client.push(step, step as f64, &Brick::new([0, 0, z0], [SIDE, SIDE, nz], &voxels))
}

fn push_whole(client: &mut Client, step: u64) -> Result<Receipt, ClientError> {
    push_planes(client, step, 0, SIDE)
}

/// Rank 0 or 1 of two, with half the grid each.
fn push_half(client: &mut Client, step: u64, rank: usize) -> Result<Receipt, ClientError> {
    push_planes(client, step, rank * SIDE / 2, SIDE / 2)
}

fn admitted(complete: bool) -> Receipt {
    Receipt::Admitted(complete)
}

/// Pushes step after step, as a simulation does, until `done`; gives the last step's result and its duration.
fn push_until(
    first: u64,
    mut push: impl FnMut(u64) -> Result<Receipt, ClientError>,
    done: impl Fn(&Result<Receipt, ClientError>) -> bool,
) -> (Result<Receipt, ClientError>, Duration) {
    let limit = Instant::now() + LONG;
    for step in first.. {
        let start = Instant::now();
        let result = push(step);
        if done(&result) {
            return (result, start.elapsed());
        }
        assert!(Instant::now() < limit, "still {result:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
    unreachable!()
}

/// What a refusal says.
fn refusal<T: std::fmt::Debug>(result: Result<T, ClientError>) -> String {
    match result {
        Err(ClientError::Refused(message)) => message,
        other => panic!("not refused: {other:?}"),
    }
}

fn timed_out(result: &Result<Receipt, ClientError>) -> bool {
    matches!(result, Err(ClientError::Deadline(_)))
}

// ---- All is well.

#[test]
fn three_ranks_hand_in_uneven_slabs_and_the_last_completes_the_step() {
    let node = Node::generator(2);
    let connect = |rank| Client::connect(rank_of(&node.url(), rank, 3, FullPolicy::Block)).unwrap();
    let mut ranks = [connect(0), connect(1), connect(2)];
    assert!(ranks.iter().all(|c| c.run_id() == ranks[0].run_id()));
    let slabs = [(0, 1), (1, 5), (6, 2)];
    for step in 0..5 {
        let receipts = [2, 0, 1].map(|r| push_planes(&mut ranks[r], step, slabs[r].0, slabs[r].1).unwrap());
        assert_eq!(receipts, [admitted(false), admitted(false), admitted(true)]);
    }
    let closed = Summary { pushed: 5, dropped: 0, lost: 0, run_dropped_steps: Some(0) };
    assert_eq!(ranks.map(Client::close), [closed; 3]);
}

#[test]
fn every_voxel_type_arrives() {
    fn push<T>(voxel_type: VoxelType, voxels: Vec<T>)
    where
        for<'a> &'a Vec<T>: Into<lamina_client::VoxelSlice<'a>>,
    {
        let node = Node::generator(8);
        let mut client = Client::connect(RunOptions { voxel_type, ..options(&node.url()) }).unwrap();
        let receipt = client.push(0, 0.0, &Brick::new([0; 3], [SIDE; 3], &voxels));
        assert_eq!(receipt.unwrap(), admitted(true), "{voxel_type}");
    }
    push(VoxelType::U8, vec![1_u8; VOXELS]);
    push(VoxelType::U16, vec![1_u16; VOXELS]);
    push(VoxelType::I16, vec![-1_i16; VOXELS]);
    push(VoxelType::F32, vec![f32::NAN; VOXELS]);
    push(VoxelType::F64, vec![1e300_f64; VOXELS]);
}

#[test]
fn a_second_field_arrives_with_the_first_and_must_be_the_one_the_scene_asks_for() {
    let node = Node::generator(8);
    let color_field = Some(("temperature".to_owned(), VoxelType::U8));
    let named = |name: &str| {
        let range = ScalarRange::new(0.0, 255.0, Scale::Linear).unwrap();
        let colors = ColorField { name: name.into(), range, points: ColorField::cool_to_warm() };
        let (grid, voxels) = (cube(SIDE), Voxels::F32((0..VOXELS).map(|n| n as f32).collect()));
        let scene = suggest(&[&Volume::new(grid, voxels).unwrap()]).unwrap();
        Some(Scene { effects: Effects { color_field: Some(colors), ..Effects::default() }, ..scene })
    };
    let open = |scene, color_field: &Option<(String, VoxelType)>| {
        Client::connect(RunOptions { scene, color_field: color_field.clone(), ..options(&node.url()) })
    };
    let message = refusal(open(named("temperature"), &None).map(drop));
    assert!(message.contains("\"temperature\"") && message.contains("color_field"), "{message}");
    let message = refusal(open(named("pressure"), &color_field).map(drop));
    assert!(message.contains("\"pressure\"") && message.contains("\"temperature\""), "{message}");

    // So does a node whose own scene asks for one.
    let config = Config { scene: named("temperature"), ..Config::default() };
    let other = Node::serve(any_port(), |listener| async {
        lamina_generator_node::run(config, Backend::cpu(), listener, Box::pin(pending())).await.unwrap();
    });
    let message = refusal(Client::connect(options(&other.url())).map(drop));
    assert!(message.contains("\"temperature\"") && message.contains("no second field"), "{message}");
    let pushes = RunOptions { color_field: color_field.clone(), ..options(&other.url()) };
    Client::connect(pushes).unwrap();

    let mut client = open(named("temperature"), &color_field).unwrap();
    let (density, heat) = (vec![1.0_f32; VOXELS], vec![7_u8; VOXELS]);
    let brick = Brick::new([0; 3], [SIDE; 3], &density);
    for (step, (brick, words)) in
        [(brick, "no voxels of temperature"), (brick.with_colors(&heat[1..]), "511 voxels of temperature")]
            .into_iter()
            .enumerate()
    {
        match client.push(step as u64, 0.0, &brick) {
            Err(ClientError::Invalid(e)) => assert!(e.reason.contains(words), "{e}"),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(client.push(2, 0.0, &brick.with_colors(&heat)).unwrap(), admitted(true));
}

// ---- Memory is full. Steps that wait for a rank that never comes hold it, so nothing here depends on speed.

#[test]
fn drop_newest_is_told_to_the_client_and_counted() {
    let node = Node::generator(2);
    let mut client = Client::connect(rank_of(&node.url(), 0, 2, FullPolicy::DropNewest)).unwrap();
    let receipts: Vec<_> = (0..4).map(|step| push_half(&mut client, step, 0).unwrap()).collect();
    assert_eq!(receipts, [admitted(false), admitted(false), Receipt::Dropped, Receipt::Dropped]);
    let all_four = Some(4);
    assert_eq!(client.close(), Summary { pushed: 2, dropped: 2, lost: 0, run_dropped_steps: all_four });
}

#[test]
fn drop_oldest_never_makes_the_simulation_wait_and_tells_the_other_rank() {
    let node = Node::generator(2);
    let connect = |rank| Client::connect(rank_of(&node.url(), rank, 2, FullPolicy::DropOldest)).unwrap();
    let (mut first, mut second) = (connect(0), connect(1));
    for step in 0..5 {
        assert_eq!(push_half(&mut first, step, 0).unwrap(), admitted(false));
    }
    let receipts: Vec<_> = (0..5).map(|step| push_half(&mut second, step, 1).unwrap()).collect();
    assert_eq!(receipts[..3], [Receipt::Dropped; 3]);
    assert_eq!(receipts[3..], [admitted(true); 2]);
    assert_eq!(first.close(), Summary { pushed: 5, dropped: 0, lost: 0, run_dropped_steps: Some(3) });
    assert_eq!(second.close(), Summary { pushed: 2, dropped: 3, lost: 0, run_dropped_steps: Some(3) });
}

#[test]
fn block_waits_no_longer_than_the_deadline() {
    let node = Node::generator(1);
    let deadline = Duration::from_millis(300);
    let options = RunOptions { deadline, ..rank_of(&node.url(), 0, 2, FullPolicy::Block) };
    let mut client = Client::connect(options).unwrap();
    // The first step to be taken fills the memory; which one that is, a loaded machine may decide.
    let (full, took) = push_until(0, |step| push_half(&mut client, step, 0), timed_out);
    assert!(matches!(full, Err(ClientError::Deadline(d)) if d == deadline), "{full:?}");
    assert!(took >= deadline && took < 10 * deadline, "{took:?}");
}

#[test]
fn block_goes_on_when_a_step_is_taken() {
    let node = Node::generator(1);
    let connect = |rank| Client::connect(rank_of(&node.url(), rank, 2, FullPolicy::Block)).unwrap();
    let (mut first, mut second) = (connect(0), connect(1));
    assert_eq!(push_half(&mut first, 0, 0).unwrap(), admitted(false));
    let waiting = std::thread::spawn(move || (push_half(&mut first, 1, 0).unwrap(), first));
    assert_eq!(push_half(&mut second, 0, 1).unwrap(), admitted(true));
    let (receipt, first) = waiting.join().unwrap();
    assert_eq!(receipt, admitted(false));
    assert_eq!(push_half(&mut second, 1, 1).unwrap(), admitted(true));
    assert_eq!((first.close().run_dropped_steps, second.close().run_dropped_steps), (Some(0), Some(0)));
}

// ---- Refusals.

#[test]
fn the_node_says_why_it_refuses_a_run() {
    let node = Node::generator(1);
    let large = RunOptions { grid: cube(64), ..options(&node.url()) };
    let message = refusal(Client::connect(large).map(drop));
    assert!(message.contains("memory_bytes") && message.contains("[64, 64, 64]"), "{message}");
    let _serving = Client::connect(rank_of(&node.url(), 0, 2, FullPolicy::Block)).unwrap();
    let other = RunOptions { name: "other".into(), ..options(&node.url()) };
    let message = refusal(Client::connect(other).map(drop));
    assert!(message.contains("\"blast\""), "{message}");
    let message = refusal(Client::connect(rank_of(&node.url(), 1, 2, FullPolicy::DropNewest)).map(drop));
    assert!(message.contains("rank 1") && message.contains("policy"), "{message}");
    let message = refusal(Client::connect(rank_of(&node.url(), 2, 2, FullPolicy::Block)).map(drop));
    assert!(message.contains("rank 2 of 2"), "{message}");
}

#[test]
fn a_refused_brick_names_ranks_and_the_run_goes_on() {
    let node = Node::generator(2);
    let connect = |rank| Client::connect(rank_of(&node.url(), rank, 2, FullPolicy::Block)).unwrap();
    let (mut first, mut second) = (connect(0), connect(1));
    push_half(&mut first, 0, 0).unwrap();
    let message = refusal(push_planes(&mut second, 0, 3, 5));
    assert!(message.contains("ranks 0 and 1 overlap"), "{message}");
    push_half(&mut first, 1, 0).unwrap();
    let message = refusal(push_planes(&mut second, 1, 6, 2));
    assert!(message.contains("cover 384 of 512 voxels"), "{message}");
    let message = refusal(push_planes(&mut second, 1, 6, 3));
    assert!(message.contains("brick"), "{message}");
    let message = refusal(push_half(&mut first, 1, 0));
    assert!(message.contains("rank 0") && message.contains("ascend"), "{message}");
    push_half(&mut first, 2, 0).unwrap();
    assert_eq!(push_half(&mut second, 2, 1).unwrap(), admitted(true));
    assert_eq!(second.close(), Summary { pushed: 1, dropped: 0, lost: 3, run_dropped_steps: Some(2) });
}

#[test]
fn addresses_that_cannot_be_are_refused_by_name() {
    for bad in ["", "127.0.0.1:7101", "https://127.0.0.1:7101", "http://127.0.0.1", "http://two words:1", "somewhere"] {
        match Client::connect(options(bad)).map(drop) {
            Err(ClientError::Invalid(e)) => {
                assert_eq!(e.thing, "generator", "{bad}");
                let named = e.reason.contains(&format!("\"{bad}\"")) && e.reason.contains("write http://HOST:PORT");
                assert!(named, "{}", e.reason);
            }
            other => panic!("\"{bad}\": {other:?}"),
        }
    }
}

// ---- What crosses the wire before admission: a node that records it.

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
        let router = tonic::transport::Server::builder().add_service(service);
        let node = Node::serve(any_port(), |listener| async {
            lamina_wire::node::serve(router, listener, Box::pin(pending())).await.unwrap();
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
    let answer = |admission: v1::Admission| Ok(v1::PushAnswer { admission: admission.into(), step_complete: true });
    // The answers stay open until the client hangs up, so that nothing it sends is missed.
    while let Ok(Some(v1::PushPart { part: Some(part) })) = parts.message().await {
        match part {
            Part::Header(header) => step = header.step,
            Part::Chunk(chunk) => bytes += chunk.len(),
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
        Ok(Response::new(v1::OpenReply { run_id: "recorded".into(), chunk_bytes: 4096 }))
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
fn bricks_of_the_wrong_type_or_length_are_refused_before_anything_is_sent() {
    let (node, records) = Recorder::start(Verdict::Admit);
    let mut client = Client::connect(options(&node.url())).unwrap();
    let (doubles, short) = (vec![0.0_f64; VOXELS], vec![0.0_f32; VOXELS - 1]);
    let right = vec![0.0_f32; VOXELS];
    let wrong = [
        (Brick::new([0; 3], [SIDE; 3], &right).with_colors(&doubles), "options do not name"),
        (Brick::new([0; 3], [SIDE; 3], &doubles), "float64 voxels of density; the run has float32"),
        (Brick::new([0; 3], [SIDE; 3], &short), "511 voxels of density for a box of [8, 8, 8]"),
        (Brick::new([0; 3], [0, SIDE, SIDE], &short[..0]), "0 voxels of density"),
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

// ---- The node is dead, stuck, restarted.

#[test]
fn a_dead_node_costs_the_simulation_nothing_and_is_found_when_it_appears() {
    let dead = dead_socket();
    let address = dead.local_addr().unwrap();
    let start = Instant::now();
    let mut client = Client::connect(options(&format!("http://{address}"))).unwrap();
    assert!(client.run_id().is_none() && start.elapsed() < LONG / 2);
    let mut slow = 0;
    for step in 0..200 {
        let start = Instant::now();
        match push_whole(&mut client, step) {
            Err(ClientError::Unreachable { address: said, .. }) => assert!(said.contains(&address.to_string())),
            other => panic!("{other:?}"),
        }
        slow += usize::from(start.elapsed() > IMMEDIATE);
    }
    // Not none: a loaded machine may take this thread's core away.
    assert!(slow <= 10, "{slow} of 200 pushes were slow");
    assert_eq!(client.summary(), Summary { lost: 200, ..Summary::default() });
    drop(dead);
    let _node = Node::generator_at(address, 2);
    assert_eq!(push_until(200, |step| push_whole(&mut client, step), Result::is_ok).0.unwrap(), admitted(true));
    assert!(client.run_id().is_some_and(|id| id.starts_with("blast-")));
    assert_eq!(client.close().pushed, 1);
}

#[test]
fn a_node_that_accepts_and_never_answers_costs_at_most_the_deadline() {
    let stuck = TcpListener::bind(any_port()).unwrap();
    let deadline = Duration::from_millis(300);
    let start = Instant::now();
    let url = format!("http://{}", stuck.local_addr().unwrap());
    let mut client = Client::connect(RunOptions { deadline, ..options(&url) }).unwrap();
    assert!(start.elapsed() >= deadline && start.elapsed() < 10 * deadline, "{:?}", start.elapsed());
    let (_, took) = push_until(0, |step| push_whole(&mut client, step), timed_out);
    assert!(took >= deadline && took < 10 * deadline, "{took:?}");
    let waits = (0..100).filter(|step| timed_out(&push_whole(&mut client, 1000 + step))).count();
    assert!(waits <= 5, "{waits} of 100 pushes waited for a node known to be stuck");
}

#[test]
fn a_simulation_that_computes_long_between_steps_keeps_its_connection() {
    let node = Node::generator(4);
    let mut client = Client::connect(options(&node.url())).unwrap();
    assert_eq!(push_whole(&mut client, 0).unwrap(), admitted(true));
    // Longer than the node waits for the answer to a ping: 10 s, and 10 s more.
    std::thread::sleep(Duration::from_secs(24));
    assert_eq!(push_whole(&mut client, 1).unwrap(), admitted(true));
}

#[test]
fn a_client_resumes_its_run_on_a_restarted_node() {
    let node = Node::generator(2);
    let mut client = Client::connect(options(&node.url())).unwrap();
    assert_eq!(push_whole(&mut client, 0).unwrap(), admitted(true));
    let run_id = client.run_id().unwrap().to_owned();
    let address = node.kill();
    let dead = push_whole(&mut client, 1);
    assert!(matches!(dead, Err(ClientError::Unreachable { .. })), "{dead:?}");
    let _restarted = Node::generator_at(address, 2);
    assert_eq!(push_until(2, |step| push_whole(&mut client, step), Result::is_ok).0.unwrap(), admitted(true));
    assert_eq!(client.run_id(), Some(run_id.as_str()));
}

#[test]
fn a_restarted_simulation_gets_a_fresh_run_and_the_old_one_does_not_take_it_back() {
    let node = Node::generator(2);
    let mut old = Client::connect(options(&node.url())).unwrap();
    assert_eq!(push_whole(&mut old, 5).unwrap(), admitted(true));
    let mut new = Client::connect(options(&node.url())).unwrap();
    assert_ne!(old.run_id(), new.run_id());
    assert_eq!(push_whole(&mut new, 0).unwrap(), admitted(true));
    let message = refusal(push_whole(&mut old, 6));
    assert!(message.contains("newer start") && message.contains(new.run_id().unwrap()), "{message}");
    assert_eq!(push_whole(&mut new, 1).unwrap(), admitted(true));
}

// ---- The services, used wrongly.

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
        full_policy: FullPolicy::Block.into(),
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
    let good = v1::GenerationParams::from(&GenerationParams::new(8, 0.1).unwrap());
    let wrong = [
        (v1::GenerationParams { resolution: 0, ..good }, "resolution"),
        (v1::GenerationParams { resolution: u32::MAX, ..good }, "resolution"),
        (v1::GenerationParams { gamma: f64::NAN, ..good }, "gamma"),
        (v1::GenerationParams { gamma: -0.1, ..good }, "gamma"),
        (v1::GenerationParams { opacity_cutoff: 0.0, ..good }, "opacity_cutoff"),
        (v1::GenerationParams { step_voxels: f64::INFINITY, ..good }, "step_voxels"),
    ];
    for (params, name) in wrong {
        let request = v1::SetParametersRequest { params: Some(params), ..Default::default() };
        refused(within(control.set_parameters(request)).await, Code::InvalidArgument, name);
        let fallback = v1::SetParametersRequest { params: Some(good), fallbacks: vec![params], ..Default::default() };
        refused(within(control.set_parameters(fallback)).await, Code::InvalidArgument, name);
    }
    refused(within(control.set_parameters(v1::SetParametersRequest::default())).await, Code::InvalidArgument, "params");
    let request = v1::SetParametersRequest { params: Some(good), from_step: 3, ..Default::default() };
    let reply = within(control.set_parameters(request)).await.unwrap().into_inner();
    assert_eq!(reply.applies_from_step, 3);
}

#[tokio::test]
async fn trials_need_a_step_a_number_and_parameters() {
    let node = Node::generator(1);
    let mut control = ControlClient::new(node.channel().await);
    let good = v1::GenerationParams::from(&GenerationParams::new(2, 0.5).unwrap());
    let ask = |trial_id, params| tokio_stream::iter([v1::TrialRequest { trial_id, params, ..Default::default() }]);
    refused(within(control.trials(ask(1, Some(good)))).await, Code::FailedPrecondition, "no step yet");

    let mut ingest = IngestClient::new(node.channel().await);
    let run_id = ingest.open(open_request()).await.unwrap().into_inner().run_id;
    push_raw(&mut ingest, vec![header(&run_id, 4), chunk(STEP_BYTES)]).await.unwrap();
    let mut reports = within(control.watch(v1::WatchRequest {})).await.unwrap().into_inner();
    let report = within(reports.message()).await.unwrap().unwrap();
    assert_eq!((report.step, report.run_id), (4, run_id));

    let bad_gamma = Some(v1::GenerationParams { gamma: f64::NAN, ..good });
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
