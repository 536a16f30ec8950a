//! Keys and certificates of a node or a simulation, and the roles that certificates state.
//!
//! A private authority signs all certificates of an installation. A certificate states its role as the DNS name
//! `ROLE.lamina.internal`, and is valid on any host: who connects checks that the other side has the role it should have.

use std::fmt;
use std::path::{Path, PathBuf};
use tonic::transport::{Certificate, ClientTlsConfig, Identity};

/// What a certificate's owner is, and so which services it may call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// Hands time steps over.
    Simulation,
    /// A generator-node.
    Generator,
    /// A viz-node.
    Viewer,
    /// A tuner.
    Tuner,
    /// Who runs them: may call everything.
    Admin,
}

lamina_model::named!(
    Role,
    "role",
    "neither simulation, generator, viewer, tuner nor admin",
    Simulation "simulation",
    Generator "generator",
    Viewer "viewer",
    Tuner "tuner",
    Admin "admin"
);

impl Role {
    /// The DNS name by which a certificate states it.
    pub fn dns_name(self) -> String {
        format!("{self}.lamina.internal")
    }
}

/// A folder with the authority's certificate `ca.pem`, an own certificate `cert.pem` and its key `key.pem`, as `lamina keys` makes them.
///
/// The files are read anew for every connection, so that they can be replaced while a node runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Credentials {
    folder: PathBuf,
}

/// What the three files hold, PEM.
pub(crate) struct Files {
    pub authority: Vec<u8>,
    pub certificate: Vec<u8>,
    pub key: Vec<u8>,
}

/// Credentials that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}; `lamina keys` makes credentials")]
pub struct CredentialsError {
    pub(crate) path: String,
    pub(crate) reason: String,
}

impl CredentialsError {
    pub(crate) fn new(path: &Path, reason: impl fmt::Display) -> Self {
        Self { path: path.display().to_string(), reason: reason.to_string() }
    }
}

/// Environment variable that names the folder where nothing else does.
pub const CREDENTIALS_VARIABLE: &str = "LAMINA_CREDENTIALS";

impl Credentials {
    /// Those in `folder`.
    ///
    /// # Errors
    /// If one of the files cannot be read.
    pub fn open(folder: impl Into<PathBuf>) -> Result<Self, CredentialsError> {
        let credentials = Self { folder: folder.into() };
        credentials.read()?;
        Ok(credentials)
    }

    /// The folder that [`CREDENTIALS_VARIABLE`] names, if it does.
    pub fn folder_of_environment() -> Option<PathBuf> {
        std::env::var_os(CREDENTIALS_VARIABLE).filter(|name| !name.is_empty()).map(PathBuf::from)
    }

    /// Where they are.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    pub(crate) fn read(&self) -> Result<Files, CredentialsError> {
        let read = |name| {
            let path = self.folder.join(name);
            std::fs::read(&path).map_err(|reason| CredentialsError::new(&path, reason))
        };
        Ok(Files { authority: read("ca.pem")?, certificate: read("cert.pem")?, key: read("key.pem")? })
    }

    /// What a connection to a node of role `server` is secured with.
    ///
    /// # Errors
    /// If one of the files cannot be read.
    pub(crate) fn client_tls(&self, server: Role) -> Result<ClientTlsConfig, CredentialsError> {
        let Files { authority, certificate, key } = self.read()?;
        let authority = Certificate::from_pem(authority);
        let identity = Identity::from_pem(certificate, key);
        Ok(ClientTlsConfig::new().domain_name(server.dns_name()).ca_certificate(authority).identity(identity))
    }
}
