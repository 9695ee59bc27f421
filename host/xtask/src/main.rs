//! The project's own chores, one module each. `cargo xtask help` lists them.

mod aside;
mod bench;
mod console;
mod emulators;
mod firmware;
mod flash;
mod fuzz;
mod house;
mod licences;
mod referee;
mod set_up;
mod size;
mod test;

use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};

use crate::house::House;

/// Sets up, tests and measures openumi.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Arguments {
    #[command(subcommand)]
    command: Chore,
}

#[derive(Subcommand)]
enum Chore {
    Test(test::Arguments),
    SetUp(set_up::Arguments),
    Firmware(firmware::Arguments),
    Flash(flash::Arguments),
    Size(size::Arguments),
    Fuzz(fuzz::Arguments),
    Bench(bench::Arguments),
    /// What `test` runs on the side.
    #[command(name = aside::CHORE, hide = true)]
    FirmwareChecks,
}

fn main() -> ExitCode {
    match run(Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            console::error(&error);
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: Arguments) -> Result<()> {
    let house = House::find()?;
    match arguments.command {
        Chore::Test(arguments) => test::run(&house, &arguments),
        Chore::SetUp(arguments) => set_up::run(&house, &arguments),
        Chore::Firmware(arguments) => firmware::run(&house, &arguments),
        Chore::Flash(arguments) => flash::run(&house, &arguments),
        Chore::Size(arguments) => size::run(&house, &arguments),
        Chore::Fuzz(arguments) => fuzz::run(&house, &arguments),
        Chore::FirmwareChecks => aside::run(&house),
        Chore::Bench(arguments) => bench::run(&house, &arguments),
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
