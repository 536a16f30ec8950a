//! Changes of a running node's configuration: SIGHUP has its file read again.

use super::config::{load_config, set_log};
use lamina_model::Invalid;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeSet;
use std::path::PathBuf;
use tokio::sync::watch;

/// A node's configuration, and where it comes from.
#[derive(Debug)]
pub struct ConfigSource<T> {
    /// The file, if there is one.
    pub path: Option<PathBuf>,
    /// What it says.
    pub in_file: T,
    /// What is in force: the file's, or the command line's.
    pub in_force: T,
    /// Keys that a running node takes up.
    pub live: &'static [&'static str],
    /// Passes what can be used.
    pub check: fn(T) -> Result<T, Invalid>,
    /// What is logged.
    pub log: fn(&T) -> &str,
}

impl<T: Serialize + DeserializeOwned + Default + Clone + Send + Sync + 'static> ConfigSource<T> {
    /// The configuration in force, now and after every SIGHUP. A file that cannot be used changes nothing, and the log says why; it also
    /// names the keys that wait for the next start.
    pub fn follow(self) -> watch::Receiver<T> {
        set_log((self.log)(&self.in_force));
        let sender = watch::Sender::new(self.in_force.clone());
        let receiver = sender.subscribe();
        tokio::spawn(self.reload_on_hangup(sender));
        receiver
    }

    #[cfg(unix)]
    async fn reload_on_hangup(mut self, sender: watch::Sender<T>) {
        use tokio::signal::unix::{SignalKind, signal};
        let Ok(mut hangups) = signal(SignalKind::hangup()) else { return };
        while hangups.recv().await.is_some() {
            match self.reload() {
                Ok(KeyChanges { taken, waiting }) => {
                    tracing::info!(
                        ?taken,
                        ?waiting,
                        "configuration read again; what waits takes effect at the next start"
                    );
                    set_log((self.log)(&self.in_force));
                    sender.send_replace(self.in_force.clone());
                }
                Err(error) => tracing::error!("configuration not read again, the one before stays in force: {error}"),
            }
        }
    }

    #[cfg(not(unix))]
    async fn reload_on_hangup(self, sender: watch::Sender<T>) {
        sender.closed().await;
    }

    fn reload(&mut self) -> Result<KeyChanges, String> {
        let in_file: T = load_config(self.path.as_deref()).map_err(|error| error.to_string())?;
        let table = |config: &T| toml::Table::try_from(config).map_err(|error| error.to_string());
        let (mut before, now, mut in_force) = (table(&self.in_file)?, table(&in_file)?, table(&self.in_force)?);
        let keys: BTreeSet<&String> = before.keys().chain(now.keys()).collect();
        let changed = keys.into_iter().filter(|key| before.get(*key) != now.get(*key)).cloned();
        let (taken, waiting): (Vec<_>, Vec<_>) = changed.partition(|key| self.live.contains(&key.as_str()));
        for table in [&mut before, &mut in_force] {
            table.retain(|key, _| !taken.iter().any(|name| name == key));
            table.extend(taken.iter().filter_map(|key| Some((key.clone(), now.get(key)?.clone()))));
        }
        let config = |table: toml::Table| table.try_into().map_err(|error: toml::de::Error| error.to_string());
        self.in_force = (self.check)(config(in_force)?).map_err(|error| error.to_string())?;
        // What waits is named again after the next reading.
        self.in_file = config(before)?;
        Ok(KeyChanges { taken, waiting })
    }
}

/// Keys that a reading of the file found changed.
#[derive(Debug, PartialEq)]
struct KeyChanges {
    /// Those in force now.
    taken: Vec<String>,
    /// Those that wait for the next start.
    waiting: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Config {
        listen: u16,
        budget: f64,
        share: Option<String>,
    }

    fn check(config: Config) -> Result<Config, Invalid> {
        if config.budget > 1.0 { Err(Invalid::new("budget", "at most 1")) } else { Ok(config) }
    }

    #[test]
    fn live_keys_are_taken_others_wait_and_what_cannot_be_used_changes_nothing() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let write = |text: &str| std::fs::write(file.path(), text).unwrap();
        let in_force = Config { listen: 9, ..Config::default() };
        let (path, in_file) = (Some(file.path().to_owned()), Config::default());
        let mut settings = ConfigSource { path, in_file, in_force, live: &["budget", "share"], check, log: |_| "info" };
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let changes = |taken: &[&str], waiting: &[&str]| KeyChanges { taken: names(taken), waiting: names(waiting) };

        write("budget = 0.5\nshare = \"25%\"\nlisten = 7");
        assert_eq!(settings.reload(), Ok(changes(&["budget", "share"], &["listen"])));
        // The address is the command line's.
        assert_eq!(settings.in_force, Config { listen: 9, budget: 0.5, share: Some("25%".to_owned()) });
        write("budget = 0.5\nlisten = 7");
        assert_eq!(settings.reload(), Ok(changes(&["share"], &["listen"])), "what waits is named again");
        for broken in ["budget = 2.0", "budget = ", "speed = 1"] {
            write(broken);
            assert!(settings.reload().is_err());
            assert_eq!(settings.in_force, Config { listen: 9, budget: 0.5, share: None }, "{broken}");
        }
        write("budget = 0.25");
        assert_eq!(settings.reload(), Ok(changes(&["budget"], &[])));
        assert_eq!(settings.in_force, Config { listen: 9, budget: 0.25, share: None });
    }
}
