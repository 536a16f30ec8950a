//! The version of the gRPC contracts: each end states its own, and a node refuses another by name.
//!
//! It rides on the `user-agent` header, `lamina/0.1.0 protocol/1`. What states none, such as a tool for gRPC, is let through.

/// Of the contracts in `proto/lamina/v1`. It rises where nodes of before and after would misunderstand each other.
pub const PROTOCOL_VERSION: u32 = 1;

/// What this end says of itself.
pub fn user_agent() -> String {
    format!("lamina/{} protocol/{PROTOCOL_VERSION}", env!("CARGO_PKG_VERSION"))
}

/// Checks what the other end says of itself.
///
/// # Errors
/// If it speaks another version; says which, and the remedy.
pub fn check_user_agent(agent: &str) -> Result<(), String> {
    let stated = |name: &str| agent.split_whitespace().find_map(|part| part.strip_prefix(name)?.strip_prefix('/'));
    let Some(version) = stated("protocol") else { return Ok(()) };
    if version.parse() == Ok(PROTOCOL_VERSION) {
        return Ok(());
    }
    Err(format!(
        "the other end speaks protocol {version} (lamina {}), this node protocol {PROTOCOL_VERSION} (lamina {}); install one version on \
         both",
        stated("lamina").unwrap_or("of an unknown version"),
        env!("CARGO_PKG_VERSION")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_version_is_refused_by_name_and_what_states_none_is_not() {
        assert_eq!(check_user_agent(&user_agent()), Ok(()));
        // As tonic sends it, and tools.
        assert_eq!(check_user_agent(&format!("{} tonic/0.14.2", user_agent())), Ok(()));
        assert_eq!(check_user_agent("grpcurl/1.9"), Ok(()));
        let refused = check_user_agent("lamina/7.0.0 protocol/70 tonic/1.0").unwrap_err();
        assert!(refused.contains("protocol 70 (lamina 7.0.0)") && refused.contains("install one version"), "{refused}");
    }
}
