//! What a user types, from one file to the other: start of the program, reading and writing
//! are in the time.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result};

use super::figures::Figures;
use crate::console;
use crate::workspace::{Workspace, execute, output};

/// As long as the programs that made somebody wait.
const MEGABYTES: u64 = 95;

/// The median counts.
const ROUNDS: usize = 9;

/// `umi nc rewrite` on a long program. `bench` is the program that writes it into `folder`.
pub fn rewriting(workspace: &Workspace, bench: &Path, folder: &Path) -> Result<Figures> {
    execute(
        workspace
            .cargo()
            .args(["build", "--release", "--package", "umi"]),
    )?;
    console::progress(&format!("timing umi nc rewrite on {MEGABYTES} MB"));
    output(
        workspace
            .command(bench)
            .args(["path", &MEGABYTES.to_string()])
            .arg(folder),
    )?;
    let program = folder.join("path.nc");
    let bytes = std::fs::metadata(&program)?.len();
    let mut rounds = Vec::new();
    let mut motions = 0.0;
    for _ in 0..ROUNDS {
        let mut command = workspace.command(workspace.target.join("release").join("umi"));
        command
            .args(["nc", "rewrite"])
            .arg(&program)
            .arg("-o")
            .arg(folder.join("out.nc"))
            .arg("--transform")
            .arg(folder.join("moved.json"))
            .arg("--force")
            .arg("--json");
        let start = Instant::now();
        let said = output(&mut command)?;
        rounds.push(start.elapsed().as_secs_f64() * 1e9);
        let said: serde_json::Value = serde_json::from_str(&said)?;
        motions = said["feeds"].as_f64().context("no number of lines cut")?;
    }
    rounds.sort_by(f64::total_cmp);
    Ok(Figures {
        task: format!("tool path of {MEGABYTES} MB, from file to file"),
        by: "`umi nc rewrite`".to_owned(),
        median_ns: rounds[ROUNDS / 2],
        min_ns: rounds[0],
        max_ns: rounds[ROUNDS - 1],
        #[allow(clippy::cast_precision_loss)]
        bytes: Some(bytes as f64),
        instructions: None,
        answer: vec![motions],
    })
}
