//! A pose with its verdict: what `localise` and `stock` answer.

use std::fmt::Write as _;
use std::path::Path;

use serde_json::{Map, Value, json};
use umi_scan::ScanError;
use umi_scan::localise::Certainty;
use umi_scan::rigid::Pose;

use super::transform::{self, FromTo};
use crate::cmd::scan::answer::failure;
use crate::failure::Failure;
use crate::show::terminal::{BAD, GOOD, Plain, paint, print, print_json};

/// Where something lies in a scan, and what stands against it.
pub(crate) struct Placed<'a> {
    /// The pose.
    pub motion: &'a Pose,
    /// Whose coordinates it carries into whose.
    pub frames: FromTo,
    /// How well it is known, where that is said.
    pub certainty: Option<&'a Certainty>,
    /// None: the verdict is OK.
    pub reasons: &'a [ScanError],
}

/// The scale of a scan with its standard uncertainty, for people.
pub(crate) fn scale(of: &Certainty) -> String {
    if of.u_scale.is_finite() {
        format!("{:.6} ± {:.6}", of.scale, of.u_scale)
    } else {
        "not told by what the scan shows".into()
    }
}

impl Placed<'_> {
    /// Writes the transform where it is wanted, prints the answer, and says the verdict by the
    /// exit status.
    pub fn answer(
        &self,
        output: Option<&Path>,
        json: bool,
        machine: impl FnOnce() -> Value,
        text: impl FnOnce() -> String,
    ) -> Result<(), Failure> {
        if let Some(path) = output {
            let (motion, verdict) = (self.motion, self.verdict());
            transform::write(path, motion, self.frames, verdict, self.certainty)
                .map_err(failure)?;
        }
        if json {
            print_json(&machine())?;
        } else {
            print(&text())?;
        }
        if self.reasons.is_empty() {
            Ok(())
        } else {
            Err(Failure::Negative)
        }
    }

    /// For machines: the transform, then the command's own fields.
    pub fn object(&self, kind: &str, fields: Value) -> Value {
        let mut map = Map::new();
        map.insert("kind".into(), kind.into());
        map.extend(transform::fields(self.motion));
        self.frames.put(&mut map);
        if let Value::Object(fields) = fields {
            map.extend(fields);
        }
        Value::Object(map)
    }

    /// OK or NG, for machines.
    pub fn verdict(&self) -> &'static str {
        if self.reasons.is_empty() { "OK" } else { "NG" }
    }

    /// The reasons, for machines.
    pub fn reasons(&self) -> Vec<Value> {
        let reason = |of: &ScanError| json!({"code": of.code, "message": of.message});
        self.reasons.iter().map(reason).collect()
    }

    /// The verdict and its reasons, for people.
    pub fn headline(&self) -> String {
        let colour = if self.reasons.is_empty() { GOOD } else { BAD };
        let mut text = format!("{}\n", paint(colour, self.verdict()));
        for reason in self.reasons {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "  {}: {}", reason.code, reason.message);
        }
        text
    }

    /// The transform, for people; `what` it is of, as "scan from part".
    pub fn pose(&self, what: &str) -> String {
        let t = &self.motion.translation_mm;
        let mut text = format!(
            "{what}, mm   {:.6}  {:.6}  {:.6}\n",
            Plain(t.x),
            Plain(t.y),
            Plain(t.z)
        );
        for row in self.motion.rotation.row_iter() {
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "   {:12.9} {:12.9} {:12.9}",
                Plain(row[0]),
                Plain(row[1]),
                Plain(row[2])
            );
        }
        text
    }
}
