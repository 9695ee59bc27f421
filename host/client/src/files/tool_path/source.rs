//! Where a transform comes from: a file of its own, or a verdict.

use std::path::Path;

use serde::Deserialize;
use serde_json::Value;
use umi_core::correction::RunCheck;
use umi_core::registration::RigidTransform;

use crate::files::points::{name, text};
use crate::problem::Problem;

/// A transform and what it is called in a program's header.
#[derive(Clone, Debug)]
pub struct ProgramSource {
    /// Nominal to measured.
    pub transform: RigidTransform,
    /// As it stands in the header.
    pub name: String,
    /// The run that was measured, where job and verdict say it: a program that is carried by it
    /// begins with an alarm in any other.
    pub run: Option<RunCheck>,
    /// The run that was measured, where nothing says how a control compares runs, and the file
    /// that says so: what is made of it for a control would run in any other.
    not_compared: Option<(u64, String)>,
}

impl ProgramSource {
    /// Of a verdict, with the job that says how runs are compared.
    #[must_use]
    pub const fn of_job(transform: RigidTransform, name: String, run: Option<RunCheck>) -> Self {
        Self {
            transform,
            name,
            run,
            not_compared: None,
        }
    }

    /// Whether a program for a control may be made of it; comparing two programs always may.
    ///
    /// # Errors
    /// `run_not_compared`: the program would run in any run, and one was measured.
    pub fn for_a_control(&self) -> Result<(), Problem> {
        let Some((run, file)) = &self.not_compared else {
            return Ok(());
        };
        Err(Problem::refused(
            "run_not_compared",
            format_args!(
                "{file}: its verdict was measured in run {run}, and a program made from this file \
                 would run in any other, too: how the control compares runs stands in the job that \
                 the board ran, and that is not in the file. Give a journal (umi log -o FILE.umij) \
                 or the board as --verdict; for a trial at a desk give rotation and translation_mm \
                 of its registration as --transform"
            ),
        )
        .with("run", *run))
    }
}

#[derive(Deserialize)]
struct Written {
    /// Rows.
    rotation: [[f64; 3]; 3],
    translation_mm: [f64; 3],
    /// What `umi scan localise` and `umi scan stock` say of it.
    verdict: Option<String>,
}

impl Written {
    fn transform(&self) -> RigidTransform {
        RigidTransform::from_rows(self.rotation, self.translation_mm)
    }
}

/// Reads `{"rotation": [[…], […], […]], "translation_mm": […]}`: what `umi register --json`
/// prints, too.
///
/// # Errors
/// The file cannot be read, or holds something else; a verdict in it is not OK.
pub fn transform(path: &Path) -> Result<ProgramSource, Problem> {
    let written: Written = serde_json::from_str(&text(path)?).map_err(|error| {
        Problem::trouble(
            "transform",
            format_args!(
                "{}: {error}; a transform is {{\"rotation\": [[1,0,0],[0,1,0],[0,0,1]], \
                 \"translation_mm\": [0,0,0]}}",
                name(path)
            ),
        )
    })?;
    if written.verdict.as_ref().is_some_and(|said| said != "OK") {
        return Err(not_ok(path, "its verdict is not OK"));
    }
    Ok(ProgramSource {
        transform: written.transform(),
        name: format!("TRANSFORM {}", stem(path)),
        run: None,
        not_compared: None,
    })
}

/// Reads the last verdict of a file of JSON lines, as `umi replay --json` prints them.
///
/// # Errors
/// The file cannot be read, a line of it is no JSON, or none is a verdict; the verdict is not OK.
pub fn verdict(path: &Path) -> Result<ProgramSource, Problem> {
    let text = text(path)?;
    let is_verdict = |value: &Value| value["type"] == "verdict";
    // One verdict, written over many lines; else one a line, each whole: behind one that is cut off another may stand.
    let whole: Option<Value> = serde_json::from_str(&text).ok();
    let all = match whole {
        Some(one) => vec![one],
        None => (1..)
            .zip(text.lines())
            .filter(|(_, line)| !line.trim().is_empty())
            .map(|(number, line)| {
                serde_json::from_str(line).map_err(|error| {
                    Problem::trouble(
                        "verdict",
                        format_args!(
                            "{}: line {number} is no JSON ({error}); if it was cut off, write the file again",
                            name(path)
                        ),
                    )
                })
            })
            .collect::<Result<_, _>>()?,
    };
    let last = all.into_iter().rfind(is_verdict).ok_or_else(|| {
        Problem::trouble(
            "verdict",
            format_args!(
                "{}: no verdict in it; `umi replay … --json` prints them",
                name(path)
            ),
        )
    })?;
    if last["verdict"] != "OK" {
        return Err(not_ok(path, "its last verdict is NG"));
    }
    let has_reasons = last["reasons"]
        .as_array()
        .is_some_and(|all| !all.is_empty());
    if has_reasons || last["reasons_dropped"].as_u64().is_some_and(|n| n > 0) {
        return Err(not_ok(
            path,
            "its last verdict says OK and has reasons against it",
        ));
    }
    let remarks = last["remarks"].as_array().into_iter().flatten();
    let mut runs = remarks.filter(|remark| remark["code"] == "of_run");
    let run = runs.next().map(|remark| {
        let run = remark["details"]["run"].as_u64();
        run.ok_or_else(|| {
            Problem::trouble(
                "verdict",
                format_args!("{}: the run of its verdict is no whole number", name(path)),
            )
        })
    });
    let run = run.transpose()?;
    let written: Written =
        serde_json::from_value(last["registration"].clone()).map_err(|error| {
            Problem::trouble(
                "verdict",
                format_args!("{}: its verdict has no registration: {error}", name(path)),
            )
        })?;
    Ok(ProgramSource {
        transform: written.transform(),
        name: format!("VERDICT OK - {} - SETUP {}", stem(path), last["plate"]),
        run: None,
        not_compared: run.map(|run| (run, name(path))),
    })
}

fn not_ok(path: &Path, why: &str) -> Problem {
    Problem::refused(
        "not_ok",
        format_args!("{}: {why}: nothing moves by it", name(path)),
    )
}

fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_string_lossy().chars().take(40).collect()
}
