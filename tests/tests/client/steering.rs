//! What people ask a simulation for reaches it, and a pause does not outlast the node.

use super::*;
use lamina_client::{SteerableNumber, SteeringRequest};
use lamina_rpc::v1::{self, frames_client::FramesClient};
use lamina_tests::processes::wait_for;
use tonic::Code;

fn number(name: &str) -> SteerableNumber {
    SteerableNumber { name: name.to_owned(), value: 1.0, least: 0.0, most: 2.0 }
}

fn steered(node: &Node, numbers: Vec<SteerableNumber>) -> Client {
    Client::connect(RunOptions { steering: Some(numbers), ..options(&node.url()) }).unwrap()
}

/// Asks as a viz-node does.
fn steer(node: &Node, run_id: &str, request: SteeringRequest) -> Result<(), tonic::Status> {
    let runtime = Runtime::new().unwrap();
    runtime.block_on(async {
        let steering = lamina_client::Steering { request, asked_by: "a person".to_owned() };
        let request = v1::SteerRequest { run_id: run_id.to_owned(), steering: Some(steering.into()) };
        FramesClient::new(node.channel().await).steer(request).await.map(|_| ())
    })
}

/// The requests up to one that is waited for.
fn until(client: &mut Client, last: &SteeringRequest) -> Vec<SteeringRequest> {
    let mut requests = Vec::new();
    let come = wait_for(LONG, || {
        requests.extend(client.steering().into_iter().map(|steering| steering.request));
        requests.last() == Some(last)
    });
    assert!(come, "{requests:?}");
    requests
}

#[test]
fn requests_come_in_their_order_and_what_is_not_offered_is_refused() {
    let node = Node::generator(2);
    let mut client = steered(&node, vec![number("inflow")]);
    push_whole(&mut client, 0).unwrap();
    let run_id = client.run_id().unwrap().to_owned();
    let set = |name: &str, value| SteeringRequest::Set { name: name.to_owned(), value };
    assert!(wait_for(LONG, || steer(&node, &run_id, set("inflow", 1.5)).is_ok()), "it never listened");
    for bad in [set("inflow", 3.0), set("inflow", f64::NAN), set("outflow", 1.0)] {
        assert_eq!(steer(&node, &run_id, bad).unwrap_err().code(), Code::FailedPrecondition);
    }
    assert_eq!(steer(&node, "another", SteeringRequest::Stop).unwrap_err().code(), Code::NotFound);
    steer(&node, &run_id, SteeringRequest::Pause).unwrap();
    steer(&node, &run_id, SteeringRequest::Stop).unwrap();
    let requests = until(&mut client, &SteeringRequest::Stop);
    assert_eq!(requests, [set("inflow", 1.5), SteeringRequest::Pause, SteeringRequest::Stop]);
    assert!(client.steering().is_empty());

    // A simulation that did not say so cannot be asked for anything.
    client.close();
    let mut deaf = connect(&node, 0, 1, FullPolicy::DropOldest);
    push_whole(&mut deaf, 0).unwrap();
    let refused = steer(&node, deaf.run_id().unwrap(), SteeringRequest::Pause).unwrap_err();
    assert!(refused.message().contains("takes no requests"), "{refused}");
}

#[test]
fn a_pause_ends_with_the_node_that_it_came_through() {
    let node = Node::generator(2);
    let mut client = steered(&node, Vec::new());
    push_whole(&mut client, 0).unwrap();
    let run_id = client.run_id().unwrap().to_owned();
    assert!(wait_for(LONG, || steer(&node, &run_id, SteeringRequest::Pause).is_ok()));
    until(&mut client, &SteeringRequest::Pause);
    let address = node.kill();
    until(&mut client, &SteeringRequest::Resume);
    // It goes on, and listens to the node that comes back.
    let node = Node::generator_at(address, 2);
    let mut step = 1;
    let back = wait_for(LONG, || {
        step += 1;
        push_whole(&mut client, step).is_ok() && steer(&node, &run_id, SteeringRequest::Stop).is_ok()
    });
    assert!(back, "nobody listens again");
    until(&mut client, &SteeringRequest::Stop);
}

#[test]
fn numbers_that_cannot_be_offered_are_a_warning_and_no_error() {
    let node = Node::generator(2);
    let mut client = steered(&node, vec![number("twice"), number("twice")]);
    push_whole(&mut client, 0).unwrap();
    std::thread::sleep(Duration::from_millis(300));
    let refused = steer(&node, client.run_id().unwrap(), SteeringRequest::Pause).unwrap_err();
    assert!(refused.message().contains("takes no requests"), "{refused}");
    push_whole(&mut client, 1).unwrap();
}
