//! The RP2040's arithmetic, which is software, is the host's, bit for bit.

use std::io::{BufRead, BufReader};
use std::time::Duration;

use serde_json::json;
use umi_figures::fits;
use umi_tests::rig::pico::{Emulator, Start};
use umi_tests::rig::{image, skip_without};

/// A chip that is silent for so long has stopped.
const PATIENCE: Duration = Duration::from_secs(600);

/// What the chip prints at the control's port, in the emulator; none where there is none.
fn chip() -> Option<Vec<String>> {
    let image = image("UMI_PICO_FIGURES", "pico-figures.elf");
    let mut emulator =
        skip_without(image.and_then(|image| Emulator::start_image(&image, Start::Paused)))?;
    let control = emulator.control().unwrap();
    control.set_read_timeout(Some(PATIENCE)).unwrap();
    emulator.ask(&json!({ "do": "free", "speed": 0 }));
    let mut fits = Vec::new();
    for line in BufReader::new(control).lines() {
        let line = line.unwrap();
        match line.strip_prefix("fit ") {
            Some(fit) => fits.push(fit.to_owned()),
            None if line == "end" => return Some(fits),
            None => panic!("the chip says: {line}"),
        }
    }
    panic!("the emulator has gone: {:?}", fits.last());
}

/// Every number of every reference fit and registration, and every refusal: no bit differs
/// between a processor that has no floating-point unit and this host, so that its decisions
/// can be replayed here.
#[test]
fn fits_on_the_chip_are_those_of_the_host() {
    let Some(chip) = chip() else {
        return;
    };
    let mut host = String::new();
    fits::print_quick(&mut host).unwrap();
    for (chip, host) in chip.iter().zip(host.lines()) {
        assert_eq!(chip, host);
    }
    assert_eq!(chip.len(), host.lines().count());
    assert!(chip.len() > 250);
}
