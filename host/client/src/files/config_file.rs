//! A board's configuration as a TOML file, with units and comments.

use serde::Deserialize;
use serde_json::{Map, Value};
use umi_protocol::config::{
    AccessConfig, BoardConfig, Ceilings, ConfigField, JournalConfig, LockedReading, SESSION_IDLE_S,
    WhenFull,
};

use crate::problem::Problem;

/// The layout of files and of `--json`. A file of version 1 has no `[access]`, and need not say its
/// version.
pub const VERSION: u32 = 2;

/// A file.
#[derive(Deserialize)]
#[serde(default, deny_unknown_fields)]
struct File {
    version: u32,
    ceilings: Ceilings,
    journal: JournalConfig,
    access: AccessConfig,
}

impl Default for File {
    fn default() -> Self {
        let BoardConfig {
            ceilings,
            journal,
            access,
        } = BoardConfig::NEW;
        Self {
            version: VERSION,
            ceilings,
            journal,
            access,
        }
    }
}

/// The version that a file says, whatever else it says.
#[derive(Deserialize)]
struct Versioned {
    version: Option<i64>,
}

/// Reads and checks a configuration. What it does not say is as on a new board.
///
/// # Errors
/// `config_version`: it is of a later umi. `config_syntax` with the line; `config_field` with the
/// field.
pub fn parse(source: &str) -> Result<BoardConfig, Problem> {
    // Before what a later version may have that this one does not know.
    if let Ok(Versioned {
        version: Some(version),
    }) = toml::from_str(source)
        && !(1..=i64::from(VERSION)).contains(&version)
    {
        let message = format!(
            "the file is of version {version}, and this umi reads up to {VERSION}: use the umi that wrote it"
        );
        return Err(Problem::refused("config_version", message).with("version", version));
    }
    let file: File = toml::from_str(source).map_err(|error| {
        let before = error.span().and_then(|span| source.get(..span.start));
        let line = before.map(|before| before.matches('\n').count() + 1);
        let at = line.map_or(String::new(), |line| format!("line {line}: "));
        let message = format!("{at}{}", error.message());
        Problem::refused("config_syntax", message).with("line", line)
    })?;
    let config = BoardConfig {
        ceilings: file.ceilings,
        journal: file.journal,
        access: file.access,
    };
    config.check().map_err(bad_field)?;
    Ok(config)
}

/// A field that cannot be used.
#[must_use]
pub fn bad_field(field: ConfigField) -> Problem {
    let name = field.name();
    let message = match field {
        ConfigField::SessionIdleS => format!(
            "`{name}` must be whole seconds from {} to {}, or be left out",
            SESSION_IDLE_S.start(),
            SESSION_IDLE_S.end()
        ),
        _ => format!("`{name}` must be a number above zero, or be left out"),
    };
    Problem::refused("config_field", message).with("field", name)
}

/// A configuration with one field set to a value as it stands in TOML; `none` takes a number away.
///
/// # Errors
/// `config_field` with the field, also where there is none of that name.
pub fn set(config: &BoardConfig, field: &str, value: &str) -> Result<BoardConfig, Problem> {
    let refused = |why: &str| {
        let names: Vec<_> = ConfigField::ALL.iter().map(|of| of.name()).collect();
        let message = format!("`{field}` {why}; fields: {}", names.join(", "));
        Problem::refused("config_field", message).with("field", field)
    };
    let known = ConfigField::ALL.iter().any(|of| of.name() == field);
    let (table, key) = field
        .split_once('.')
        .filter(|_| known)
        .ok_or_else(|| refused("is no field of the configuration"))?;
    let mut all =
        toml::Table::try_from(config).map_err(|error| Problem::trouble("config_syntax", error))?;
    let fields = all
        .entry(table)
        .or_insert_with(|| toml::Table::new().into())
        .as_table_mut()
        .ok_or_else(|| refused("is no field of the configuration"))?;
    if value == "none" {
        fields.remove(key);
    } else {
        // A word is a text, without quotes, too.
        let parsed = |text: &str| toml::from_str::<toml::Table>(&format!("value = {text}"));
        let found = parsed(value).or_else(|_| parsed(&format!("\"{value}\"")));
        let found = found.ok().and_then(|mut found| found.remove("value"));
        let found = found.ok_or_else(|| refused("has no such value"))?;
        // 1 is as good as 1.0.
        let found = match found {
            toml::Value::Integer(whole) if table == "ceilings" => toml::Value::Float(whole as f64),
            found => found,
        };
        fields.insert(key.to_owned(), found);
    }
    let config: BoardConfig = all.try_into().map_err(|error: toml::de::Error| {
        refused(&format!("cannot be {value}: {}", error.message()))
    })?;
    config.check().map_err(bad_field)?;
    Ok(config)
}

/// The fields by their names, in their order; what is not set is null.
#[must_use]
pub fn fields(config: &BoardConfig) -> Vec<(&'static str, Value)> {
    let all = json(config);
    ConfigField::ALL
        .iter()
        .map(|field| {
            let name = field.name();
            let (table, key) = name.split_once('.').unwrap_or_default();
            (name, all[table][key].clone())
        })
        .collect()
}

/// The configuration for machines.
#[must_use]
pub fn json(config: &BoardConfig) -> Value {
    serde_json::to_value(config).unwrap_or_else(|_| Value::Object(Map::new()))
}

/// The file's text, each field with what it is; what is not set stands in a comment.
#[must_use]
pub fn text(config: &BoardConfig) -> String {
    let mut text = format!(
        "# What the owner of an openumi board allows, whatever a job asks for.\nversion = {VERSION}\n"
    );
    let mut table = "";
    for (name, value) in fields(config) {
        let (of, key) = name.split_once('.').unwrap_or_default();
        if of != table {
            text += &format!("\n[{of}]\n");
            table = of;
        }
        text += &match value {
            Value::Null => format!("# {key} = {}  # {}\n", unset(name), about(name, config)),
            value => format!("{key} = {value}  # {}\n", about(name, config)),
        };
    }
    text
}

/// What a number is that is not set.
#[must_use]
pub fn unset(name: &str) -> &'static str {
    match name {
        "access.session_idle_s" => "none",
        _ => "any",
    }
}

fn about(name: &str, config: &BoardConfig) -> &'static str {
    match name {
        "ceilings.require_witness" => "true: a job must have [witness]",
        "ceilings.always" => "false: no program goes out without a verdict",
        "journal.full" => match config.journal.full {
            WhenFull::Overwrite => "the oldest evidence is overwritten, counted and told",
            WhenFull::Refuse => "nothing goes out before evidence would be lost",
        },
        "access.locked_reading" => match config.access.locked_reading {
            LockedReading::Operators => "a locked board is read by an operator's key",
            LockedReading::Nobody => "nobody reads a locked board; an owner can unlock it",
        },
        "access.session_idle_s" => {
            "s without a request, then a key must be proven again; none: with the connection"
        }
        "access.button_off" => "true: the board's button teaches nothing",
        name if name.ends_with("_deg") => "degrees at most in a job's [limits]",
        _ => "mm at most in a job's [limits]",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What was written is read, whatever is set; a file that says nothing is a new board.
    #[test]
    fn a_file_comes_back_as_it_was() {
        let mut config = BoardConfig::default();
        assert_eq!(parse("").unwrap(), config);
        assert_eq!(parse(&text(&config)).unwrap(), config);
        for (field, value) in [
            ("ceilings.rms_mm", "0.01"),
            ("ceilings.rotation_deg", "2"),
            ("ceilings.require_witness", "true"),
            ("ceilings.always", "false"),
            ("journal.full", "refuse"),
            ("access.locked_reading", "nobody"),
            ("access.session_idle_s", "600"),
            ("access.button_off", "true"),
        ] {
            config = set(&config, field, value).unwrap();
            assert_eq!(parse(&text(&config)).unwrap(), config);
        }
        assert_eq!(config.ceilings.rms_mm, Some(0.01));
        assert_eq!(config.ceilings.rotation_deg, Some(2.0));
        assert!(config.ceilings.require_witness && !config.ceilings.always);
        assert_eq!(config.journal.full, WhenFull::Refuse);
        assert_eq!(
            config.access,
            AccessConfig {
                locked_reading: LockedReading::Nobody,
                session_idle_s: Some(600),
                button_off: true,
            }
        );
        for number in ["ceilings.rms_mm", "access.session_idle_s"] {
            config = set(&config, number, "none").unwrap();
        }
        assert_eq!(config.ceilings.rms_mm, None);
        assert_eq!(config.access.session_idle_s, None);
    }

    /// A file of before, which says no version and has no `[access]`, is read as it was meant; one of
    /// a later version is told from one that is wrong.
    #[test]
    fn the_version_of_a_file_is_told() {
        let before = "[ceilings]\nrms_mm = 0.5\n\n[journal]\nfull = \"refuse\"\n";
        let config = parse(before).unwrap();
        assert_eq!(config.ceilings.rms_mm, Some(0.5));
        assert_eq!(config.access, AccessConfig::NEW);
        assert_eq!(parse(&format!("version = 1\n{before}")).unwrap(), config);
        for version in [0, VERSION + 1, 99] {
            let later = format!("version = {version}\n[walls]\nheight_m = 2\n");
            let error = parse(&later).unwrap_err();
            assert_eq!(error.code, "config_version", "{version}");
            assert_eq!(error.details["version"], version);
        }
        let error = parse("version = \"new\"").unwrap_err();
        assert_eq!(error.code, "config_syntax");
    }

    /// What is wrong is named.
    #[test]
    fn bad_fields_are_named() {
        let config = BoardConfig::default();
        for (field, value) in [
            ("ceilings.rms_mm", "0"),
            ("ceilings.rms_mm", "-1"),
            ("ceilings.rms_mm", "nan"),
            ("ceilings.rms_mm", "wide"),
            ("ceilings.always", "1"),
            ("journal.full", "perhaps"),
            ("ceilings.none", "1"),
            ("access.session_idle_s", "9"),
            ("access.session_idle_s", "86401"),
            ("access.session_idle_s", "60.5"),
            ("access.session_idle_s", "-1"),
            ("access.locked_reading", "everybody"),
            ("access.button_off", "0"),
            ("access.keys", "[]"),
            ("version", "1"),
            ("rms_mm", "1"),
            ("", "1"),
        ] {
            let error = set(&config, field, value).unwrap_err();
            assert_eq!(error.code, "config_field", "{field} {value}");
            assert_eq!(error.details["field"], field);
        }
        for source in [
            "[ceilings]\nrms = 1",
            "ceilings = 3",
            "[other]",
            "x",
            // Keys come by `umi access enrol` alone.
            "[access]\nkeys = []",
            "[[access.keys]]\nrole = \"owner\"",
        ] {
            assert_eq!(parse(source).unwrap_err().code, "config_syntax", "{source}");
        }
        let error = parse("[ceilings]\nshift_mm = -0.5").unwrap_err();
        assert_eq!(error.details["field"], "ceilings.shift_mm");
    }
}
