//! The node's side of TLS 1.3: its certificate, and those that it accepts.

use crate::credentials::{Credentials, CredentialsError, Files, Role};
use parking_lot::Mutex;
use std::fmt;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use tokio_rustls::rustls::client::verify_server_name;
use tokio_rustls::rustls::crypto::{CryptoProvider, ring};
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use tokio_rustls::rustls::server::{ParsedCertificate, WebPkiClientVerifier};
use tokio_rustls::rustls::version::TLS13;
use tokio_rustls::rustls::{RootCertStore, ServerConfig};

/// How long before its end a certificate is warned of.
const NOTICE: Duration = Duration::from_secs(30 * 24 * 3600);

/// A node's credentials as they were last read. New files are taken up by the next connection.
pub struct ServerTls {
    credentials: Credentials,
    current: Mutex<LoadedTls>,
}

/// What was read, and when its files were written.
struct LoadedTls {
    written: Option<SystemTime>,
    config: Arc<ServerConfig>,
    valid_until: SystemTime,
}

impl fmt::Debug for ServerTls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ServerTls").field("credentials", &self.credentials).finish_non_exhaustive()
    }
}

impl ServerTls {
    /// Reads them.
    ///
    /// # Errors
    /// If they cannot be used, or the certificate has expired.
    pub(super) fn open(credentials: Credentials) -> Result<Self, CredentialsError> {
        let (config, valid_until) = load(&credentials)?;
        let current = LoadedTls { written: changed_at(&credentials), config: Arc::new(config), valid_until };
        Ok(Self { credentials, current: Mutex::new(current) })
    }

    /// What the next connection is secured with: the newest files that can be used.
    pub(super) fn config(&self) -> Arc<ServerConfig> {
        let mut current = self.current.lock();
        let changed = changed_at(&self.credentials);
        if changed != current.written {
            match load(&self.credentials) {
                Ok((config, valid_until)) => {
                    tracing::info!(folder = %self.credentials.folder().display(), "new credentials");
                    current.config = Arc::new(config);
                    current.valid_until = valid_until;
                }
                // Its authority may not be there yet.
                Err(error) => tracing::warn!("{error}; the ones before stay in use"),
            }
            current.written = changed;
        }
        current.config.clone()
    }

    /// When the node's certificate expires.
    pub(super) fn valid_until(&self) -> SystemTime {
        self.current.lock().valid_until
    }
}

/// When the certificate was written.
fn changed_at(credentials: &Credentials) -> Option<SystemTime> {
    std::fs::metadata(credentials.folder().join("cert.pem")).and_then(|file| file.modified()).ok()
}

/// Certificates of peers are asked for and checked, not demanded: which service needs one says [`super::AllowRoles`].
fn load(credentials: &Credentials) -> Result<(ServerConfig, SystemTime), CredentialsError> {
    let Files { authority, certificate, key } = credentials.read()?;
    let path = |name: &str| credentials.folder().join(name);
    let chain = certificates(&path("cert.pem"), &certificate)?;
    let valid_until = check_validity(&path("cert.pem"), &chain)?;
    let key = PrivateKeyDer::from_pem_slice(&key).map_err(|e| CredentialsError::new(&path("key.pem"), e))?;
    let mut roots = RootCertStore::empty();
    roots.add_parsable_certificates(certificates(&path("ca.pem"), &authority)?);
    let provider: Arc<CryptoProvider> = Arc::new(ring::default_provider());
    let failed = |e: &dyn fmt::Display| CredentialsError::new(credentials.folder(), e);
    let verifier = WebPkiClientVerifier::builder_with_provider(Arc::new(roots), provider.clone())
        .allow_unauthenticated()
        .build()
        .map_err(|e| failed(&e))?;
    let mut config = ServerConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&TLS13])
        .map_err(|e| failed(&e))?
        .with_client_cert_verifier(verifier)
        .with_single_cert(chain, key)
        .map_err(|e| failed(&e))?;
    config.alpn_protocols = vec![b"h2".to_vec(), b"http/1.1".to_vec()];
    Ok((config, valid_until))
}

fn certificates(path: &Path, pem: &[u8]) -> Result<Vec<CertificateDer<'static>>, CredentialsError> {
    let read = CertificateDer::pem_slice_iter(pem).collect::<Result<Vec<_>, _>>();
    let certificates = read.map_err(|e| CredentialsError::new(path, e))?;
    if certificates.is_empty() {
        return Err(CredentialsError::new(path, "holds no certificate"));
    }
    Ok(certificates)
}

/// Refuses a certificate that has expired, and warns of one that soon will have; its end.
fn check_validity(path: &Path, chain: &[CertificateDer]) -> Result<SystemTime, CredentialsError> {
    let end = chain.first().and_then(|first| valid_until(first));
    let end = end.ok_or_else(|| CredentialsError::new(path, "states no time until which it is valid"))?;
    match end.duration_since(SystemTime::now()) {
        Err(_) => return Err(CredentialsError::new(path, "has expired")),
        Ok(left) if left < NOTICE => {
            let days = left.as_secs() / (24 * 3600);
            tracing::warn!(certificate = %path.display(), "expires in {days} days; `lamina keys` makes another");
        }
        Ok(_) => {}
    }
    Ok(end)
}

/// The end of a certificate's validity (RFC 5280, section 4.1).
fn valid_until(certificate: &CertificateDer) -> Option<SystemTime> {
    let read = yasna::parse_der(certificate, |certificate| {
        certificate.read_sequence(|parts| {
            let until = parts.next().read_sequence(|fields| {
                fields.read_optional(|version| version.read_tagged(yasna::Tag::context(0), |v| v.read_der()))?;
                // Serial number, algorithm of the signature, issuer.
                for _ in 0..3 {
                    fields.next().read_der()?;
                }
                let until = fields.next().read_sequence(|validity| {
                    validity.next().read_der()?;
                    validity.next().read_der()
                })?;
                while fields.read_optional(|rest| rest.read_der())?.is_some() {}
                Ok(until)
            })?;
            // Algorithm and signature.
            parts.next().read_der()?;
            parts.next().read_der()?;
            Ok(until)
        })
    });
    let until = read.ok()?;
    let utc = || yasna::parse_der(&until, |time| time.read_utctime()).map(|time| *time.datetime());
    let general = || yasna::parse_der(&until, |time| time.read_generalized_time()).map(|time| *time.datetime());
    utc().or_else(|_| general()).ok().map(SystemTime::from)
}

/// The role that the certificate states which a connection has shown and proved.
pub(super) fn stated_role(shown: Option<&[CertificateDer]>) -> Option<Role> {
    let parsed = shown.and_then(<[_]>::first).and_then(|first| ParsedCertificate::try_from(first).ok())?;
    let states = |role: &Role| {
        let name = ServerName::try_from(role.dns_name());
        name.is_ok_and(|name| verify_server_name(&parsed, &name).is_ok())
    };
    Role::ALL.into_iter().find(states)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with a certificate of its own authority, valid until `end`.
    fn folder(end: SystemTime) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let mut params = rcgen::CertificateParams::new([Role::Tuner.dns_name()]).unwrap();
        params.not_after = end.into();
        let key = rcgen::KeyPair::generate().unwrap();
        let certificate = params.self_signed(&key).unwrap();
        for (name, pem) in
            [("ca.pem", certificate.pem()), ("cert.pem", certificate.pem()), ("key.pem", key.serialize_pem())]
        {
            std::fs::write(folder.path().join(name), pem).unwrap();
        }
        folder
    }

    fn open(folder: &tempfile::TempDir) -> Result<ServerTls, CredentialsError> {
        ServerTls::open(Credentials::open(folder.path()).unwrap())
    }

    #[test]
    fn the_end_of_validity_is_read_in_both_forms_of_time() {
        // RFC 5280: UTCTime through 2049, GeneralizedTime from 2050 on.
        for seconds in [1_900_000_000, 2_600_000_000] {
            let end = SystemTime::UNIX_EPOCH + Duration::from_secs(seconds);
            let folder = folder(end);
            let pem = std::fs::read(folder.path().join("cert.pem")).unwrap();
            let chain = certificates(folder.path(), &pem).unwrap();
            assert_eq!(valid_until(&chain[0]), Some(end));
            assert_eq!(stated_role(Some(&chain)), Some(Role::Tuner));
            assert!(open(&folder).is_ok());
        }
        assert_eq!(valid_until(&CertificateDer::from_slice(b"nothing")), None);
        assert_eq!(stated_role(None), None);
    }

    #[test]
    fn expired_damaged_and_missing_files_are_refused_by_name() {
        let expired = folder(SystemTime::now() - Duration::from_secs(60));
        let said = open(&expired).unwrap_err().to_string();
        assert!(said.contains("cert.pem: has expired") && said.contains("lamina keys"), "{said}");
        let year = SystemTime::now() + Duration::from_secs(365 * 24 * 3600);
        for name in ["ca.pem", "cert.pem", "key.pem"] {
            let damaged = folder(year);
            std::fs::write(damaged.path().join(name), "-----BEGIN NOTHING-----").unwrap();
            let said = open(&damaged).unwrap_err().to_string();
            assert!(said.contains(name), "{said}");
            std::fs::remove_file(damaged.path().join(name)).unwrap();
            assert!(Credentials::open(damaged.path()).unwrap_err().to_string().contains(name));
        }
        // A key of another certificate.
        let (one, other) = (folder(year), folder(year));
        std::fs::copy(other.path().join("key.pem"), one.path().join("key.pem")).unwrap();
        assert!(open(&one).is_err());
    }
}
