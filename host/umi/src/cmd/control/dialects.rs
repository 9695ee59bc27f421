//! `umi dialects`

use crate::failure::Failure;
use crate::show::terminal::{TITLE, Table, paint, print, print_json};
use clap::Args;
use serde_json::{Value, json};
use umi_core::correction::dialect::{Form, Turn, about, form};
use umi_protocol::job::Dialect;

use crate::cmd::Format;

/// What each control understands: the table of correction programs
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Dialects {
    /// Controls, sources and what has been tried, of this one only
    #[arg(value_name = "NAME")]
    name: Option<String>,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The job's `correction.dialect` takes one of these names. `umi correction` shows the
program that would be sent.

Examples:
  umi dialects
  umi dialects siemens
  umi dialects --json";

impl Dialects {
    pub fn run(self) -> Result<(), Failure> {
        let chosen: Vec<Dialect> = match &self.name {
            None => Dialect::ALL.to_vec(),
            Some(name) => Dialect::ALL
                .into_iter()
                .filter(|d| d.name() == name)
                .collect(),
        };
        if chosen.is_empty() {
            return Err(Failure::trouble(
                "usage",
                "there is no such dialect; `umi dialects` lists them",
            ));
        }
        if self.format.json {
            return chosen.into_iter().try_for_each(|d| print_json(&machine(d)));
        }
        let mut text = table(&chosen).to_string();
        for dialect in &chosen {
            let about = about(*dialect);
            text += &format!(
                "\n{}  {}\n  tried    {}\n",
                paint(TITLE, dialect.name()),
                about.controls,
                about.tried
            );
            if self.name.is_some() {
                text += &format!("  sources  {}\n", about.sources);
            }
        }
        print(&text)
    }
}

/// Degrees of freedom, and which rotations.
const fn expresses(form: &Form) -> (u8, &'static str) {
    match form.turn {
        Turn::No => (3, "none"),
        Turn::Point | Turn::Origin => (4, "about Z"),
        Turn::Axis | Turn::Angles => (6, "any"),
    }
}

fn further(form: &Form) -> Option<String> {
    form.further.map(|(name, digits, first, last)| {
        let width = usize::from(digits);
        format!("{name}{first:0width$} to {last:0width$}")
    })
}

fn step(decimals: u8) -> f64 {
    0.1f64.powi(decimals.into())
}

fn table(dialects: &[Dialect]) -> Table {
    let titles = ["dialect", "rotation", "steps", "to mm", "offsets", "set"];
    let mut table = Table::new("<<<><<").titles(&titles);
    for dialect in dialects {
        let form = form(*dialect);
        let (mm, deg) = (form.decimals_mm, form.decimals_deg);
        let (freedom, rotation) = expresses(&form);
        let mut steps = format!("{:.*} mm", mm.into(), step(mm));
        if freedom > 3 {
            steps += &format!(", {:.*}\u{b0}", deg.into(), step(deg));
        }
        let mut offsets = format!("G54 to G{}", 53 + form.standard);
        if *dialect == Dialect::Heidenhain {
            offsets = "presets".into();
        }
        if let Some(further) = further(&form) {
            offsets += &format!(", {further}");
        }
        let rotation = if form.turn_ends_with_program {
            format!("{rotation}, not with M30")
        } else {
            rotation.into()
        };
        table.row([
            dialect.name().to_owned(),
            rotation,
            steps,
            format!("{}", form.limit_mm),
            offsets,
            match form.set {
                None => "-".into(),
                Some((first, last, _)) if first == last => first.to_string(),
                Some((first, last, default)) => format!("{first} to {last}, else {default}"),
            },
        ]);
    }
    table
}

fn machine(dialect: Dialect) -> Value {
    let form = form(dialect);
    let about = about(dialect);
    let (freedom, rotation) = expresses(&form);
    json!({
        "type": "dialect",
        "dialect": dialect.name(),
        "degrees_of_freedom": freedom,
        "rotation": rotation,
        "rotation_ends_with_main_program": form.turn_ends_with_program,
        "step_mm": step(form.decimals_mm),
        "step_deg": (freedom > 3).then(|| step(form.decimals_deg)),
        "limit_mm": form.limit_mm,
        "standard_offsets": form.standard,
        "further_offsets": further(&form),
        "set": form.set.map(|(first, last, default)| json!({
            "first": first,
            "last": last,
            "default": default,
        })),
        "controls": about.controls,
        "tried": about.tried,
        "sources": about.sources,
    })
}
