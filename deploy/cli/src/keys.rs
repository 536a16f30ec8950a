//! `lamina keys`: a private certificate authority, and a folder of credentials for each role.

use crate::cli::Keys;
use anyhow::{Context, bail};
use lamina_rpc::credentials::Role;
use rcgen::string::Ia5String;
use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
    SanType,
};
use std::fs;
use std::io::Write as _;
use std::net::IpAddr;
use std::path::Path;
use std::time::{Duration, SystemTime};

/// How long before now certificates become valid: clocks of hosts differ.
const EARLIER: Duration = Duration::from_secs(3600);
/// How long the authority's own certificate is valid, days.
const AUTHORITY_DAYS: u32 = 3650;
const AUTHORITY: &str = "authority";

/// Makes new certificates of all roles or of one, and the authority if there is none yet.
///
/// # Errors
/// If a name is none, or the folder cannot be written.
pub fn keys(arguments: &Keys) -> anyhow::Result<()> {
    if !(1..=AUTHORITY_DAYS).contains(&arguments.days) {
        bail!("--days {}: give 1 to {AUTHORITY_DAYS}", arguments.days);
    }
    let folder = &arguments.folder;
    let authority = authority(folder)?;
    let roles = arguments.role.map_or(Role::ALL.to_vec(), |role| vec![role]);
    for role in roles {
        certificate(folder, role, &authority, arguments)?;
    }
    eprintln!("credentials are in {}: give each node the folder of its role with --credentials,", folder.display());
    eprintln!("simulations `simulation` in LAMINA_CREDENTIALS; keep `{AUTHORITY}` where nobody else reads it");
    Ok(())
}

/// The authority of `folder`; a new one where there is none.
fn authority(folder: &Path) -> anyhow::Result<Issuer<'static, KeyPair>> {
    let own = folder.join(AUTHORITY);
    let path = own.join("key.pem");
    let params = authority_params()?;
    if path.exists() {
        let pem = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let key = KeyPair::from_pem(&pem).with_context(|| format!("{}: no private key", path.display()))?;
        return Ok(Issuer::new(params, key));
    }
    let key = KeyPair::generate()?;
    create_folder(&own)?;
    write(&own.join("ca.pem"), &params.self_signed(&key)?.pem())?;
    write(&path, &key.serialize_pem())?;
    Ok(Issuer::new(params, key))
}

fn authority_params() -> anyhow::Result<CertificateParams> {
    let mut params = valid_for(AUTHORITY_DAYS)?;
    params.distinguished_name.push(DnType::CommonName, "Lamina private authority");
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    Ok(params)
}

fn valid_for(days: u32) -> anyhow::Result<CertificateParams> {
    let mut params = CertificateParams::new(Vec::new())?;
    let now = SystemTime::now();
    params.not_before = (now - EARLIER).into();
    params.not_after = (now + Duration::from_secs(u64::from(days) * 24 * 3600)).into();
    Ok(params)
}

/// A new certificate of `role` with a new key.
fn certificate(
    folder: &Path,
    role: Role,
    authority: &Issuer<'static, KeyPair>,
    arguments: &Keys,
) -> anyhow::Result<()> {
    let mut params = valid_for(arguments.days)?;
    params.distinguished_name.push(DnType::CommonName, format!("Lamina {role}"));
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ClientAuth, ExtendedKeyUsagePurpose::ServerAuth];
    params.use_authority_key_identifier_extension = true;
    params.subject_alt_names.push(dns_name(&role.dns_name())?);
    if role == Role::Viewer {
        // Browsers look at the host's name.
        let own = ["localhost".to_owned(), "127.0.0.1".to_owned(), "::1".to_owned(), lamina_rpc::connect::host_name()];
        for host in own.iter().filter(|host| !host.is_empty()).chain(&arguments.host) {
            params.subject_alt_names.push(match host.parse::<IpAddr>() {
                Ok(ip) => SanType::IpAddress(ip),
                Err(_) => dns_name(host)?,
            });
        }
    }
    let key = KeyPair::generate()?;
    let certificate = params.signed_by(&key, authority)?;
    let own = folder.join(role.name());
    create_folder(&own)?;
    let authority = folder.join(AUTHORITY).join("ca.pem");
    write(&own.join("ca.pem"), &fs::read_to_string(&authority).with_context(|| authority.display().to_string())?)?;
    write(&own.join("key.pem"), &key.serialize_pem())?;
    // The last: nodes that run read all three when it changes.
    write(&own.join("cert.pem"), &certificate.pem())
}

fn dns_name(name: &str) -> anyhow::Result<SanType> {
    let name: Ia5String = name.try_into().with_context(|| format!("\"{name}\" is no name of a host"))?;
    Ok(SanType::DnsName(name))
}

fn create_folder(path: &Path) -> anyhow::Result<()> {
    let mut builder = fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.recursive(true).create(path).with_context(|| format!("{}: cannot be made", path.display()))
}

/// Replaces a file, readable by its owner alone, as a whole.
fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    let new = path.with_extension("new");
    let written = || -> std::io::Result<()> {
        let mut options = fs::OpenOptions::new();
        options.write(true).create(true).truncate(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let mut file = options.open(&new)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&new, path)
    };
    written().with_context(|| format!("{}: cannot be written", path.display()))
}
