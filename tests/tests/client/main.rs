//! The real client against a real generator-node: what a simulation meets when all is well, and when nothing is.
//!
//! Also the ingest and control services themselves, used wrongly on purpose. What a VDI contains is no matter here.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod memory;
mod outages;
mod refusals;
mod services;
mod shared_memory;
mod steering;
mod steps;
mod wire;

use glam::DVec3;
use lamina_client::{Brick, Client, ClientError, FullPolicy, Receipt, RunOptions};
use lamina_compute::CpuShare;
use lamina_generator_node::Config;
use lamina_model::{GenerationParams, Grid, VoxelType};
use lamina_raycast::Backend;
use std::future::pending;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;
use tonic::transport::Channel;

const SIDE: usize = 8;
const VOXELS: usize = SIDE * SIDE * SIDE;
const STEP_BYTES: usize = 4 * VOXELS;
/// Far more than anything here takes on a loaded machine; met only by a hang.
const LONG: Duration = Duration::from_secs(60);

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

    fn configured(address: SocketAddr, config: Config) -> Self {
        Self::serve(address, |listener| async {
            let share = CpuShare::new(config.cpu_share).unwrap();
            let settings = tokio::sync::watch::Sender::new(config).subscribe();
            lamina_generator_node::run(settings, Backend::cpu(), share, listener, Box::pin(pending())).await.unwrap();
        })
    }

    fn generator_at(address: SocketAddr, waiting: usize) -> Self {
        let working = 2 * STEP_BYTES + 12 * VOXELS;
        let config = Config {
            memory_bytes: (working + waiting * STEP_BYTES) as u64,
            params: Some(GenerationParams::vdi(2, 0.5).unwrap()),
            reference_every: 0,
            ..Config::default()
        };
        Self::configured(address, config)
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

fn cube(side: usize) -> Grid {
    Grid::new([side; 3], DVec3::ONE, DVec3::ZERO).unwrap()
}

fn options(url: &str) -> RunOptions {
    RunOptions { deadline: LONG, ..RunOptions::new(url, "blast", "density", cube(SIDE), VoxelType::F32) }
}

fn rank_of(url: &str, rank: u32, ranks: u32, full_policy: FullPolicy) -> RunOptions {
    RunOptions { rank, ranks, full_policy, ..options(url) }
}

fn connect(node: &Node, rank: u32, ranks: u32, full_policy: FullPolicy) -> Client {
    Client::connect(rank_of(&node.url(), rank, ranks, full_policy)).unwrap()
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
