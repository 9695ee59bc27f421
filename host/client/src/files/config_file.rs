//! A board's configuration as a TOML file, with units and comments.

use serde_json::{Map, Value};
use umi_protocol::config::{BoardConfig, ConfigField, WhenFull};

use crate::problem::Problem;

/// The layout of files and of `--json`.
pub const VERSION: u32 = 1;

/// Reads and checks a configuration. What it does not say is as on a new board.
///
/// # Errors
/// `config_syntax` with the line; `config_field` with the field.
pub fn parse(source: &str) -> Result<BoardConfig, Problem> {
    let config: BoardConfig = toml::from_str(source).map_err(|error| {
        let before = error.span().and_then(|span| source.get(..span.start));
        let line = before.map(|before| before.matches('\n').count() + 1);
        let at = line.map_or(String::new(), |line| format!("line {line}: "));
        let message = format!("{at}{}", error.message());
        Problem::refused("config_syntax", message).with("line", line)
    })?;
    config.check().map_err(bad_field)?;
    Ok(config)
}

/// A field that cannot be used.
#[must_use]
pub fn bad_field(field: ConfigField) -> Problem {
    let name = field.name();
    let message = format!("`{name}` must be a number above zero, or be left out");
    Problem::refused("config_field", message).with("field", name)
}

/// A configuration with one field set to a value as it stands in TOML; `none` takes a ceiling away.
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
            toml::Value::Integer(whole) => toml::Value::Float(whole as f64),
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
    let mut text =
        String::from("# What the owner of an openumi board allows, whatever a job asks for.\n");
    let mut table = "";
    for (name, value) in fields(config) {
        let (of, key) = name.split_once('.').unwrap_or_default();
        if of != table {
            text += &format!("\n[{of}]\n");
            table = of;
        }
        text += &match value {
            Value::Null => format!("# {key} = any\n"),
            value => format!("{key} = {value}  # {}\n", about(name, config)),
        };
    }
    text
}

fn about(name: &str, config: &BoardConfig) -> &'static str {
    match name {
        "ceilings.require_witness" => "true: a job must have [witness]",
        "ceilings.always" => "false: no program goes out without a verdict",
        "journal.full" => match config.journal.full {
            WhenFull::Overwrite => "the oldest evidence is overwritten, counted and told",
            WhenFull::Refuse => "nothing goes out before evidence would be lost",
        },
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
        ] {
            config = set(&config, field, value).unwrap();
            assert_eq!(parse(&text(&config)).unwrap(), config);
        }
        assert_eq!(config.ceilings.rms_mm, Some(0.01));
        assert_eq!(config.ceilings.rotation_deg, Some(2.0));
        assert!(config.ceilings.require_witness && !config.ceilings.always);
        assert_eq!(config.journal.full, WhenFull::Refuse);
        config = set(&config, "ceilings.rms_mm", "none").unwrap();
        assert_eq!(config.ceilings.rms_mm, None);
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
            ("rms_mm", "1"),
            ("", "1"),
        ] {
            let error = set(&config, field, value).unwrap_err();
            assert_eq!(error.code, "config_field", "{field} {value}");
            assert_eq!(error.details["field"], field);
        }
        for source in ["[ceilings]\nrms = 1", "ceilings = 3", "[other]", "x"] {
            assert_eq!(parse(source).unwrap_err().code, "config_syntax", "{source}");
        }
        let error = parse("[ceilings]\nshift_mm = -0.5").unwrap_err();
        assert_eq!(error.details["field"], "ceilings.shift_mm");
    }
}
