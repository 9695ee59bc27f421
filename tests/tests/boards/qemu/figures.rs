//! The Cortex-M7's arithmetic is the host's, bit for bit; and what work costs it, in
//! instructions.

use std::fmt::Write as _;
use std::process::Command;

use umi_figures::fits;
use umi_figures::work::names;
use umi_tests::rig::{image, is_installed, skip_without};

const QEMU: &str = "qemu-system-arm";

/// What the chip prints.
struct Figures {
    /// Lines of the fits.
    fits: String,
    /// The name of each work, and the instructions of one unit.
    work: Vec<(String, u64)>,
}

fn figures() -> Option<Figures> {
    let image = image("UMI_MPS2_FIGURES", "mps2-an500-figures.elf").and_then(|image| {
        let missing = format!("there is no {QEMU}; `cargo xtask set-up` brings it");
        is_installed(QEMU).then_some(image).ok_or(missing)
    });
    let image = skip_without(image)?;
    let run = Command::new(QEMU)
        .args(["-M", "mps2-an500", "-display", "none", "-nodefaults"])
        // An instruction takes a nanosecond.
        .args(["-icount", "shift=0"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(image)
        .output()
        .unwrap();
    let printed = String::from_utf8(run.stdout).unwrap();
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{said}{printed}");
    let mut figures = Figures {
        fits: String::new(),
        work: Vec::new(),
    };
    for line in printed.lines() {
        match line.split_once(' ').unwrap() {
            ("fit", fit) => writeln!(figures.fits, "{fit}").unwrap(),
            ("work", work) => {
                let mut words = work.splitn(3, ' ');
                let mut number = || words.next().unwrap().parse::<u64>().unwrap();
                let (units, instructions) = (number(), number());
                let name = words.next().unwrap().to_owned();
                figures.work.push((name, instructions / units));
            }
            _ => panic!("{line}"),
        }
    }
    Some(figures)
}

/// Every number of every reference fit and registration, and every refusal: no bit differs
/// between the chip and this host, so a journal replays to the same decisions on a PC.
#[test]
fn fits_on_the_chip_are_those_of_the_host() {
    let Some(chip) = figures() else {
        return;
    };
    let mut host = String::new();
    fits::print(&mut host).unwrap();
    for (chip, host) in chip.fits.lines().zip(host.lines()) {
        assert_eq!(chip, host);
    }
    assert_eq!(chip.fits.lines().count(), host.lines().count());
    assert!(host.lines().count() > 250);
}

/// What work may cost, in instructions of a unit: some 10 % above what it costs with rustc
/// 1.95 and 1.96, as room for other compilers.
const BUDGETS: [(&str, u64); 19] = [
    (names::BYTE, 480),
    (names::SPHERE_5, 55_300),
    (names::REGISTRATION_3, 43_100),
    (names::REGISTRATION_5, 48_500),
    (names::SPHERE_500, 2_470_000),
    (names::REGISTRATION_500, 1_450_000),
    (names::APPEND, 9_500),
    (names::SETUP, 677_000),
    (names::VERDICT, 233_500),
    // A tenth of what a line of 115200 baud leaves a core of 480 MHz for each of its 11520
    // bytes a second is 4166.
    (names::LACES, 166),
    (names::CHORDS, 179),
    // The goal itself: it takes 1 895 480 (2026-11-29).
    (names::CALIBRATION_100, 2_000_000),
    (names::PLACE, 140),
    // At 9000 a second a core of 480 MHz has 53 333 for each.
    (names::READING, 3_700),
    (names::SIGN, 1_960_000),
    (names::VERIFY, 2_210_000),
    (names::SESSION, 6_060_000),
    (names::SEAL, 15_700),
    // An image of 640 KB in 64 million: a seventh of a second on a core of 480 MHz.
    (names::DIGEST, 97),
];

/// The counts stay within their budgets, and repeat to the last instruction, so that they
/// can be held at all.
#[test]
fn instructions_stay_within_their_budgets() {
    let (Some(first), Some(second)) = (figures(), figures()) else {
        return;
    };
    assert_eq!(first.work, second.work);
    let work: Vec<&str> = first.work.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(work, BUDGETS.map(|(name, _)| name));
    for ((name, instructions), (_, budget)) in first.work.iter().zip(BUDGETS) {
        assert!(
            *instructions <= budget,
            "{name}: {instructions} instructions, more than the {budget} that it may cost"
        );
        // A budget far above is none.
        assert!(
            instructions * 4 > budget * 3,
            "{name}: {instructions} instructions, far fewer than {budget}: lower the budget"
        );
    }
}
