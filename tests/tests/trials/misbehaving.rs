//! Viz-nodes that subscribe like one and answer wrong: they are left out by name, and the study goes on.

use super::*;

/// How a viz-node misbehaves that subscribes like one.
#[derive(Clone, Copy)]
enum Lie {
    /// It measures nothing but NaN.
    Nan,
    /// It answers for another trial.
    Other,
    /// It ends its answer without a measurement.
    Nothing,
    /// It measures other batches than it was asked for.
    Batches,
}

struct Liar(Lie);

#[tonic::async_trait]
impl quality_server::Quality for Liar {
    type MeasureStream = stream::Iter<std::vec::IntoIter<Result<v1::QualityReply, Status>>>;

    async fn measure(&self, request: Request<v1::QualityRequest>) -> Result<Response<Self::MeasureStream>, Status> {
        let v1::QualityRequest { trial_id, batches, .. } = request.into_inner();
        let reply = |trial_id, mse, batches| {
            let batch_mse = vec![mse; batches as usize];
            Ok(v1::QualityReply {
                trial_id,
                views: vec![v1::View { angle_deg: 10.0, batch_mse, ..Default::default() }],
            })
        };
        let at_work = Ok(v1::QualityReply { trial_id, views: Vec::new() });
        let replies = match self.0 {
            Lie::Nan => vec![at_work, reply(trial_id, f64::NAN, batches)],
            Lie::Other => vec![at_work, reply(trial_id + 1, 1e-3, batches)],
            Lie::Nothing => vec![at_work],
            Lie::Batches => vec![reply(trial_id, 1e-3, batches + 1)],
        };
        Ok(Response::new(stream::iter(replies)))
    }

    type StepsStream = stream::Pending<Result<v1::StepQuality, Status>>;

    async fn steps(&self, _: Request<v1::StepsRequest>) -> Result<Response<Self::StepsStream>, Status> {
        Ok(Response::new(stream::pending()))
    }

    type NegotiateStream = stream::Pending<Result<v1::ContractRequest, Status>>;

    async fn negotiate(
        &self,
        _: Request<tonic::Streaming<v1::TunerUpdate>>,
    ) -> Result<Response<Self::NegotiateStream>, Status> {
        Ok(Response::new(stream::pending()))
    }
}

/// Starts one; it stays subscribed as long as the stream is held.
async fn liar(cluster: &Cluster, lie: Lie) -> (String, impl Stream + use<>) {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let service = quality_server::QualityServer::new(Liar(lie));
    let incoming = tonic::transport::server::TcpIncoming::from(listener);
    tokio::spawn(tonic::transport::Server::builder().add_service(service).serve_with_incoming(incoming));
    (address.clone(), subscribe(cluster, &address).await.unwrap())
}

#[test]
fn a_viewer_that_measures_nan_is_left_out_and_alone_it_is_a_clear_error() {
    let log = Log::start();
    let cluster = Cluster::start();
    let candidates = candidates(6);
    run(async {
        let (address, _subscription) = liar(&cluster, Lie::Nan).await;
        let mut remote = cluster.remote(1).await.unwrap();
        let error = remote.evaluate(&candidates, Batches::All).await.unwrap_err().to_string();
        assert!([address.as_str(), "NaN", "start a viz-node"].iter().all(|w| error.contains(w)), "{error}");
        // What was measured before is not lost: the first candidate's cost needs nobody any more.
        let known = remote.evaluate(&candidates[..1], Batches::None).await.unwrap();
        assert!(known[0].as_ref().unwrap().cost.size_bytes > 0);

        let _honest = cluster.viz();
        let rows = cluster.remote(2).await.unwrap().evaluate(&candidates, Batches::All).await.unwrap();
        assert!(rows.iter().all(|r| r.as_ref().unwrap().quality.batches() == 16));
        assert_eq!(log.warnings(&address).len(), 2, "one warning for each of the two studies");
        // The study given up goes on with whoever comes.
        let rows = remote.evaluate(&candidates, Batches::All).await.unwrap();
        assert!(rows.iter().all(|r| r.as_ref().unwrap().quality.psnr_db().is_finite()));
    });
}

#[test]
fn a_viewer_that_answers_something_else_is_left_out_by_name_and_the_study_goes_on() {
    for (lie, word) in [(Lie::Other, "instead of"), (Lie::Nothing, "without a measurement"), (Lie::Batches, "batches")]
    {
        let (log, cluster) = (Log::start(), Cluster::start());
        run(async {
            let (address, _subscription) = liar(&cluster, lie).await;
            let _honest = cluster.viz();
            let rows = cluster.remote(2).await.unwrap().evaluate(&candidates(6), Batches::All).await.unwrap();
            assert!(rows.iter().all(|r| r.as_ref().unwrap().quality.batches() == 16));
            let warnings = log.warnings(&address);
            assert!(warnings.len() == 1 && warnings[0].contains(word), "{warnings:?}");
        });
    }
}
