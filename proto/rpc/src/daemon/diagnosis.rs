//! The service by which `lamina doctor --cluster` finds out how well a node is reached.

use super::AllowRoles;
use crate::credentials::Role;
use crate::protocol::user_agent;
use crate::v1::{self, diagnosis_server};
use std::time::{SystemTime, UNIX_EPOCH};
use tonic::service::interceptor::InterceptedService;
use tonic::{Request, Response, Status};

/// The most bytes of a reply's payload.
const MOST_BYTES: u32 = 1 << 20;

/// Tells the clock and the version, and sends as many bytes as it is asked for.
#[derive(Debug)]
pub struct DiagnosisService;

/// The service, for owners of any role's certificate.
pub fn diagnosis() -> InterceptedService<diagnosis_server::DiagnosisServer<DiagnosisService>, AllowRoles> {
    diagnosis_server::DiagnosisServer::with_interceptor(DiagnosisService, AllowRoles(&Role::ALL))
}

#[tonic::async_trait]
impl diagnosis_server::Diagnosis for DiagnosisService {
    async fn probe(&self, request: Request<v1::ProbeRequest>) -> Result<Response<v1::ProbeReply>, Status> {
        let bytes = request.into_inner().reply_bytes;
        if bytes > MOST_BYTES {
            return Err(Status::invalid_argument(format!("reply_bytes: {bytes}; at most {MOST_BYTES} are sent")));
        }
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let clock_ns = u64::try_from(since.as_nanos()).unwrap_or(u64::MAX);
        Ok(Response::new(v1::ProbeReply { clock_ns, agent: user_agent(), payload: vec![0; bytes as usize] }))
    }
}
