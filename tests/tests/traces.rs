//! Traces: the spans of all nodes reach a collector of OpenTelemetry's, those of one step or trial in one trace.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_client::{Brick, Client, RunOptions};
use lamina_model::{Grid, VoxelType};
use lamina_tests::processes::{Daemon, binary, free_port, wait_for};
use opentelemetry_proto::tonic::collector::trace::v1::trace_service_server::{TraceService, TraceServiceServer};
use opentelemetry_proto::tonic::collector::trace::v1::{ExportTraceServiceRequest, ExportTraceServiceResponse};
use opentelemetry_proto::tonic::common::v1::{KeyValue, any_value::Value};
use opentelemetry_proto::tonic::trace::v1::Span;
use std::collections::HashMap;
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tonic::{Request, Response, Status};

/// Spans, and which service each is of.
type Spans = Arc<Mutex<Vec<(String, Span)>>>;

/// Keeps what arrives.
struct Collector(Spans);

fn text(attributes: &[KeyValue], key: &str) -> Option<String> {
    let found = attributes.iter().find(|attribute| attribute.key == key)?.value.clone()?.value?;
    match found {
        Value::StringValue(text) => Some(text),
        Value::IntValue(number) => Some(number.to_string()),
        Value::DoubleValue(number) => Some(number.to_string()),
        _ => None,
    }
}

#[tonic::async_trait]
impl TraceService for Collector {
    async fn export(
        &self,
        request: Request<ExportTraceServiceRequest>,
    ) -> Result<Response<ExportTraceServiceResponse>, Status> {
        for of_service in request.into_inner().resource_spans {
            let service = text(&of_service.resource.unwrap_or_default().attributes, "service.name").unwrap_or_default();
            let spans = of_service.scope_spans.into_iter().flat_map(|scope| scope.spans);
            self.0.lock().unwrap().extend(spans.map(|span| (service.clone(), span)));
        }
        Ok(Response::new(ExportTraceServiceResponse { partial_success: None }))
    }
}

fn traced(name: &str, arguments: &[&str], collector: u16) -> Daemon {
    let port = free_port();
    let mut command = Command::new(binary(name));
    command.args(arguments).args(["--listen", &format!("127.0.0.1:{port}")]).stdout(std::process::Stdio::null());
    command.env("OTEL_EXPORTER_OTLP_ENDPOINT", format!("http://127.0.0.1:{collector}"));
    command.env("OTEL_BSP_SCHEDULE_DELAY", "200").env("RUST_LOG", "error");
    Daemon::spawn(command, port)
}

/// The traces whose first span, of `service`, is called `name`, as names of all spans with their services.
fn traces(spans: &Spans, service: &str, name: &str) -> Vec<Vec<String>> {
    let spans = spans.lock().unwrap();
    let mut by_trace: HashMap<Vec<u8>, Vec<&(String, Span)>> = HashMap::new();
    spans.iter().for_each(|span| by_trace.entry(span.1.trace_id.clone()).or_default().push(span));
    let is_first = |(of, span): &&&(String, Span)| of == service && span.name == name && span.parent_span_id.is_empty();
    let of_trace = |trace: &Vec<&(String, Span)>| {
        let first = &trace.iter().find(is_first)?.1;
        assert!(text(&first.attributes, "lamina.step").is_some(), "{first:?}");
        let others = trace.iter().filter(|(_, span)| span.span_id != first.span_id);
        others.clone().for_each(|(_, span)| assert_eq!(span.parent_span_id, first.span_id, "{span:?}"));
        Some(others.map(|(of, span)| format!("{of}: {}", span.name)).collect())
    };
    by_trace.values().filter_map(of_trace).collect()
}

#[test]
fn a_step_and_a_trial_are_followed_through_all_nodes() {
    let (spans, port) = (Spans::default(), free_port());
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let collector = TraceServiceServer::new(Collector(spans.clone()));
    let serve = tonic::transport::Server::builder().add_service(collector).serve(([127, 0, 0, 1], port).into());
    runtime.spawn(serve);

    let generator = traced("generator-node", &[], port);
    let viz = traced("viz-node", &["--generator", &generator.url()], port);
    let tuner = traced("tuner", &["--generator", &generator.url()], port);
    let grid = Grid::new([24; 3], glam::DVec3::ONE, glam::DVec3::ZERO).unwrap();
    let values: Vec<f32> = (0..24 * 24 * 24).map(|n| (n % 24) as f32 * (n / 576) as f32).collect();
    let options = RunOptions::new(&generator.url(), "traced", "density", grid, VoxelType::F32);
    let mut client = Client::connect(options).unwrap();
    let followed = |service: &str, name: &str, wanted: &[&str]| {
        let is_whole = |trace: &Vec<String>| wanted.iter().all(|name| trace.iter().any(|span| span == name));
        traces(&spans, service, name).iter().any(is_whole)
    };
    let made = "generator-node: generate and encode";
    let of_step = ["generator-node: wait", made, "viz-node: record", "viz-node: decode", "viz-node: measure"];
    let of_trial = ["tuner: generator-node", "tuner: viz-node", made, "viz-node: decode and measure"];
    let mut step = 0;
    let found = wait_for(Duration::from_secs(60), || {
        let _ = client.push(step, step as f64, &Brick::new([0; 3], grid.dims(), &values));
        step += 1;
        std::thread::sleep(Duration::from_millis(100));
        followed("generator-node", "step", &of_step) && followed("tuner", "trial", &of_trial)
    });
    let seen = (traces(&spans, "generator-node", "step"), traces(&spans, "tuner", "trial"));
    assert!(found, "{} spans; steps and trials: {seen:?}", spans.lock().unwrap().len());

    // What is left is sent when a node ends; a collector that is gone holds none up.
    let before = spans.lock().unwrap().len();
    let _ = client.push(step, step as f64, &Brick::new([0; 3], grid.dims(), &values));
    client.close();
    assert_eq!(generator.terminate(), Some(0));
    assert!(wait_for(Duration::from_secs(5), || spans.lock().unwrap().len() > before));
    runtime.shutdown_background();
    let begun = std::time::Instant::now();
    assert_eq!([tuner.terminate(), viz.terminate()], [Some(0); 2]);
    assert!(begun.elapsed() < Duration::from_secs(15), "{:?}", begun.elapsed());
}
