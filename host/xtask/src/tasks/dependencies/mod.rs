//! Dependencies: which nobody uses, which are allowed and have no advisory, and who has read them.

mod deny;
mod unused;
mod vet;

use anyhow::Result;

use crate::workspace::{Workspace, find_program};

/// cargo-deny and cargo-vet, as cargo finds them, with the releases that set-up installs.
pub const PROGRAMS: [[&str; 2]; 2] = [["cargo-deny", "0.20.2"], ["cargo-vet", "0.10.3"]];

/// Why not all can be checked here, with what to do.
pub fn missing() -> Option<String> {
    let [deny, vet] = PROGRAMS.map(|[program, _]| (program, "cargo xtask set-up"));
    [
        deny,
        vet,
        ("git", "apt-get install git"),
        ("tar", "install tar"),
    ]
    .into_iter()
    .find(|(program, _)| find_program(program).is_none())
    .map(|(program, remedy)| format!("no {program}: {remedy}"))
}

/// Holds that every package of ours uses what it depends on.
pub fn check_use(workspace: &Workspace) -> Result<()> {
    unused::check(workspace)
}

/// Holds the rules of `deny.toml` and the lists of `tests/supply-chain`.
pub fn check_trust(workspace: &Workspace) -> Result<()> {
    deny::check(workspace)?;
    vet::check(workspace)
}
