//! The project's own tasks, one module each. `cargo xtask help` lists them.

mod console;
mod tasks;
mod tools;
mod workspace;

use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};

use crate::tasks::{background, bench, firmware, flash, fuzz, release, set_up, size, test};
use crate::workspace::Workspace;

/// Sets up, tests and measures openumi.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Arguments {
    #[command(subcommand)]
    command: Task,
}

#[derive(Subcommand)]
enum Task {
    Test(test::Arguments),
    SetUp(set_up::Arguments),
    Firmware(firmware::Arguments),
    Flash(flash::Arguments),
    Sbom(firmware::sbom::Arguments),
    Reproduce(firmware::reproduce::Arguments),
    Release(release::Arguments),
    Size(size::Arguments),
    Fuzz(fuzz::Arguments),
    Bench(bench::Arguments),
    /// What `test` runs in the background.
    #[command(name = background::TASK, hide = true)]
    FirmwareChecks(background::Arguments),
}

fn main() -> ExitCode {
    if std::env::var_os(firmware::crate_names::WRAPS).is_some() {
        return firmware::crate_names::call(std::env::args_os().skip(1));
    }
    match run(Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            console::error(&error);
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: Arguments) -> Result<()> {
    let workspace = Workspace::find()?;
    match arguments.command {
        Task::Test(arguments) => test::run(&workspace, &arguments),
        Task::SetUp(arguments) => set_up::run(&workspace, &arguments),
        Task::Firmware(arguments) => firmware::run(&workspace, &arguments),
        Task::Flash(arguments) => flash::run(&workspace, &arguments),
        Task::Sbom(arguments) => firmware::sbom::run(&workspace, &arguments),
        Task::Reproduce(arguments) => firmware::reproduce::run(&workspace, &arguments),
        Task::Release(arguments) => release::run(&workspace, &arguments),
        Task::Size(arguments) => size::run(&workspace, &arguments),
        Task::Fuzz(arguments) => fuzz::run(&workspace, &arguments),
        Task::FirmwareChecks(arguments) => background::run(&workspace, &arguments),
        Task::Bench(arguments) => bench::run(&workspace, &arguments),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::Arguments;

    /// clap finds contradictions between arguments only when it builds the command.
    #[test]
    fn arguments_are_consistent() {
        <Arguments as CommandFactory>::command().debug_assert();
    }
}
