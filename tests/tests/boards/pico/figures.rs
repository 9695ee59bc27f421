//! The RP2040's arithmetic, which is software, is the host's, bit for bit.

use std::io::{BufRead, BufReader};
use std::time::Duration;

use serde_json::json;
use umi_figures::fits;
use umi_tests::rig::pico::{Emulator, Start};
use umi_tests::rig::{image, skip_without};

/// A chip that is silent for so long has stopped.
const PATIENCE: Duration = Duration::from_secs(600);

/// What the chip prints.
struct Figures {
    fits: Vec<String>,
    /// Readings of a point sensor, and the microseconds of the chip's clock that they took.
    readings: (f64, f64),
}

/// What the chip prints at the control's port up to the end of the last of these parts, in the emulator; none
/// where there is none.
fn chip(parts: usize) -> Option<Figures> {
    let image = image("UMI_PICO_FIGURES", "pico-figures.elf");
    let mut emulator =
        skip_without(image.and_then(|image| Emulator::start_image(&image, Start::Paused)))?;
    let control = emulator.control().unwrap();
    control.set_read_timeout(Some(PATIENCE)).unwrap();
    emulator.ask(&json!({ "do": "free", "speed": 0 }));
    let (mut fits, mut readings) = (Vec::new(), None);
    for line in BufReader::new(control).lines() {
        let line = line.unwrap();
        let words: Vec<&str> = line.split(' ').collect();
        match *words {
            ["fit", ..] => fits.push(line["fit ".len()..].to_owned()),
            ["readings", count, taken_us] => {
                readings = Some((count.parse().unwrap(), taken_us.parse().unwrap()));
            }
            ["part", part] if part.parse() == Ok(parts - 1) => {
                let readings = readings.expect("its readings are paired");
                return Some(Figures { fits, readings });
            }
            ["part", _] => {}
            _ => panic!("the chip says: {line}"),
        }
    }
    panic!("the emulator has gone: {:?}", fits.last());
}

/// Readings of a point sensor that are read and paired in a second, if the processor has nothing else to do: some 10 %
/// below what it was measured to be.
const LEAST_HZ: f64 = 4300.0;

/// Every number of reference fits and registrations, and every refusal: no bit differs between a processor
/// that has no floating-point unit and this host, so that its decisions can be replayed here.
fn is_as_on_the_host(parts: usize) {
    let Some(chip) = chip(parts) else {
        return;
    };
    let mut host = String::new();
    for part in 0..parts {
        fits::print_part(part, &mut host).unwrap();
    }
    for (chip, host) in chip.fits.iter().zip(host.lines()) {
        assert_eq!(chip, host);
    }
    assert_eq!(chip.fits.len(), host.lines().count());
    assert!(chip.fits.len() > 60 * parts);
    let (count, taken_us) = chip.readings;
    let rate_hz = count * 1e6 / taken_us;
    println!("readings paired: {rate_hz:.0} a second");
    // Of the chip's own clock, so the same each time.
    assert!((LEAST_HZ..1.3 * LEAST_HZ).contains(&rate_hz), "{rate_hz}");
}

#[test]
fn a_quarter_of_the_fits_on_the_chip_is_that_of_the_host() {
    is_as_on_the_host(1);
}

#[test]
#[ignore = "a minute of emulation"]
fn fits_on_the_chip_are_those_of_the_host() {
    is_as_on_the_host(fits::PARTS);
}
