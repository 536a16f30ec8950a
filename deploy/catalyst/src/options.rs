//! What a run is called and where it goes: from the node `lamina` of Catalyst's or Ascent's, else from the environment.

use crate::conduit::Node;
use lamina_model::SteerableNumber;
use std::path::PathBuf;
use std::time::Duration;

/// What may be stated; nothing has to be.
#[derive(Debug)]
pub(crate) struct CatalystOptions {
    /// The generator-node: `generator`, LAMINA_GENERATOR.
    pub(crate) generator: String,
    /// The run's name: `name`, LAMINA_NAME; else the program's.
    pub(crate) name: String,
    /// The channel shown: `channel`, LAMINA_CHANNEL; else the first.
    pub(crate) channel: Option<String>,
    /// The field shown, or the component of a vector, NAME/COMPONENT: `field`, LAMINA_FIELD; else the first of scalars.
    pub(crate) field: Option<String>,
    /// Further fields, what expressions call them and what the mesh does: `more_fields`, LAMINA_MORE_FIELDS, `v.x=velocity/u,p`.
    pub(crate) more_fields: Vec<(String, String)>,
    /// What is shown first, an expression over the fields: `shown`, LAMINA_SHOWN.
    pub(crate) shown: Option<String>,
    /// Sample points of a mesh that is resampled: `points`, LAMINA_POINTS, `128` or `96 48 48`.
    pub(crate) points: Option<String>,
    /// `credentials`, LAMINA_CREDENTIALS.
    pub(crate) credentials: Option<PathBuf>,
    /// The longest a call may take, seconds: `deadline`.
    pub(crate) deadline: Option<Duration>,
    /// Numbers that people who watch may change: `steering/NAME/{value,least,most}`; none, but `steering`: they may pause and stop.
    pub(crate) steering: Option<Vec<SteerableNumber>>,
}

impl CatalystOptions {
    /// Those that the node `lamina` and the environment state.
    pub(crate) fn read(stated: Option<Node>) -> Self {
        let text = |name: &str, variable: &str| {
            let node = stated.and_then(|node| node.text_at(name));
            node.or_else(|| std::env::var(variable).ok()).filter(|text| !text.is_empty())
        };
        let program = || {
            let program = std::env::current_exe().ok()?;
            Some(program.file_stem()?.to_string_lossy().into_owned())
        };
        let steering = stated.and_then(|node| node.at("steering")).map(|node| {
            let number = |(name, of): (String, Node)| {
                let [value, least, most] = ["value", "least", "most"].map(|part| of.number(part));
                Some(SteerableNumber { name, value: value?, least: least?, most: most? })
            };
            node.children().into_iter().filter_map(number).collect()
        });
        Self {
            points: text("points", "LAMINA_POINTS"),
            generator: text("generator", "LAMINA_GENERATOR").unwrap_or_else(|| "http://127.0.0.1:7101".to_owned()),
            name: text("name", "LAMINA_NAME").or_else(program).unwrap_or_else(|| "catalyst".to_owned()),
            channel: text("channel", "LAMINA_CHANNEL"),
            field: text("field", "LAMINA_FIELD"),
            more_fields: text("more_fields", "LAMINA_MORE_FIELDS").map_or_else(Vec::new, |text| pairs(&text)),
            shown: text("shown", "LAMINA_SHOWN"),
            credentials: text("credentials", "LAMINA_CREDENTIALS").map(PathBuf::from),
            deadline: stated
                .and_then(|node| node.number("deadline"))
                .and_then(|secs| Duration::try_from_secs_f64(secs).ok()),
            steering,
        }
    }

    /// What all ranks have to have alike, as text.
    pub(crate) fn of_all_ranks(&self) -> Vec<u8> {
        let more = self.more_fields.iter().map(|(name, field)| format!("{name}={field}")).collect::<Vec<_>>().join(",");
        let parts = [self.points.as_deref(), self.field.as_deref(), self.channel.as_deref(), Some(&more)];
        parts.map(Option::unwrap_or_default).join("\n").into_bytes()
    }

    /// Takes over what rank 0 has.
    pub(crate) fn take_over(&mut self, of_first: &[u8]) {
        let text = String::from_utf8_lossy(of_first);
        let mut parts = text.split('\n').map(|part| (!part.is_empty()).then(|| part.to_owned()));
        let mut next = || parts.next().flatten();
        (self.points, self.field, self.channel) = (next(), next(), next());
        self.more_fields = next().map_or_else(Vec::new, |more| pairs(&more));
    }
}

/// `NAME=FIELD` or `FIELD` alone, apart by commas.
fn pairs(text: &str) -> Vec<(String, String)> {
    let parts = text.split(',').map(str::trim).filter(|part| !part.is_empty());
    parts.map(|part| part.split_once('=').unwrap_or((part, part))).map(|(a, b)| (a.to_owned(), b.to_owned())).collect()
}
