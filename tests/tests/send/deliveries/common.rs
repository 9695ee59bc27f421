//! Programs, jobs, and what the control should get.

use umi_client::board::link::Client;
use umi_client::programs;
use umi_core::correction::withheld;
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{ProgramIdentity, RewriteSettings, Rewriter};
use umi_core::units::Mm;
use umi_protocol::job::{Job, SendWhen};
use umi_protocol::pattern::{CheckedPattern, Coding, LinePattern};
use umi_protocol::program::{
    IntegerRule, Piece, ProgramInfo, Release, RewriteSpec, Stated, UnitRule, Withheld,
};
use umi_protocol::verdict::{RegistrationReport, Verdict};
use umi_tests::cases::*;
use umi_tests::rig::{Rig, VirtualRig};

/// A pocket: straight lines, arcs, a canned cycle.
pub const POCKET: &str = "%\nO1234(POCKET)\nG21 G90 G17 G94 G98\nG0 X0. Y0. Z50.\nG1 Z-2. F300\n\
    G1 X40. F800\nG3 X50. Y10. I0. J10.\nG1 Y30.\nX0.\nY0.\nG0 Z50.\nG81 X5. Y5. Z-4. R2.\n\
    X15.\nG80\nM30\n%\n";

/// The pocket and many lines more: longer than what goes out while somebody looks.
pub fn long() -> String {
    let lines: String = (0..120)
        .map(|line| format!("G1 X{line}.5 Y-{line}.25\n"))
        .collect();
    POCKET.replace("M30", &(lines + "M30"))
}

pub const SPEC: RewriteSpec = RewriteSpec {
    decimals_mm: 3,
    chord_um: 20,
    clearance_um: 1000,
    integers: IntegerRule::Refused,
    unit: UnitRule::Said,
};

pub fn info(number: u32, text: &str, release: Release) -> ProgramInfo {
    ProgramInfo {
        number,
        name: "PART".parse().unwrap(),
        bytes: u32::try_from(text.len()).unwrap(),
        crc32: programs::check_value(text.as_bytes()),
        release,
        hold_s: 5,
        stated: Stated::default(),
    }
}

/// One that does nothing.
pub const NINE: &str = "%\nO0009\nM30\n%\n";

/// A virtual board with this job.
pub fn start(job: &Job) -> (VirtualRig, Client) {
    let mut rig = VirtualRig::start().unwrap();
    let mut client = connect(&mut rig);
    client.set_job(job).unwrap().unwrap();
    (rig, client)
}

pub fn put(client: &mut Client, number: u32, text: &str, release: Release, hold_s: u16) {
    let program = ProgramInfo {
        hold_s,
        ..info(number, text, release)
    };
    programs::put(client, &program, text.as_bytes(), |_| {}).unwrap();
}

/// Bytes of a text, as one message takes them.
pub fn piece(text: &str, offset: u32) -> Piece {
    text.bytes().skip(offset as usize).take(200).collect()
}

/// Lets the board ask the control for a program, as soon as it has done with the one before;
/// it does.
pub fn asks_for_blocks(rig: &mut dyn Rig, client: &mut Client) {
    until(rig, "the end of the one before", |_| {
        client.program_receive().unwrap().ok()
    });
    assert_eq!(receive(rig, 1), "\u{15}");
}

/// A block of XMODEM.
pub fn block(number: u8, piece: &[u8]) -> Vec<u8> {
    let mut block = vec![1, number, !number];
    block.extend(piece);
    block.resize(131, 0x1A);
    let sum = |sum: u8, byte: &u8| sum.wrapping_add(*byte);
    block.push(block[3..].iter().fold(0, sum));
    block
}

/// The session's job, without a correction of its own.
pub fn plain_job() -> Job {
    Job {
        correction: None,
        ..job()
    }
}

/// The session's job with its runs counted; it rewrites programs and sends no correction.
pub fn job_of_runs() -> Job {
    let mut job = job();
    let checked = LinePattern::Checked(CheckedPattern::default());
    job.receiver.patterns.push(checked).unwrap();
    (job.guards.run_variable, job.guards.frame) = (Some(531), true);
    if let Some(correction) = &mut job.correction {
        correction.send = SendWhen::Never;
    }
    job
}

/// What the control gets that asks for this number and then reads.
pub fn read(rig: &mut dyn Rig, number: u32) {
    rig.control_sends(format!("READ O{number}\r\n").as_bytes());
    rig.control_sends(DC1);
}

pub fn alarm_of(number: u32, why: &Withheld) -> String {
    let text = withheld(number, why, Coding::Ascii);
    text.as_str().to_owned()
}

/// The same program, rewritten by the same code on the host.
pub fn rewritten(text: &str, job: &Job, verdict: &Verdict) -> String {
    rewritten_with(text, job, verdict, |settings| settings)
}

/// The same, by other settings.
pub fn rewritten_with(
    text: &str,
    job: &Job,
    verdict: &Verdict,
    with: impl FnOnce(RewriteSettings) -> RewriteSettings,
) -> String {
    let RegistrationReport {
        rotation,
        translation_mm,
        ..
    } = verdict.registration.clone().unwrap();
    let transform = RigidTransform::from_rows(rotation, translation_mm);
    let settings = RewriteSettings {
        chord: Mm(0.02),
        original: Some(ProgramIdentity {
            crc32: programs::check_value(text.as_bytes()),
            bytes: text.len() as u64,
        }),
        source: format!("VERDICT OK - {} - SETUP {}", job.name, verdict.setup)
            .parse()
            .unwrap(),
        // A board takes them: who puts a program there was asked.
        loose_rapids: true,
        ..RewriteSettings::new(transform)
    };
    let mut out = Vec::new();
    let mut sink = |bytes: &[u8]| out.extend_from_slice(bytes);
    let mut rewriter = Rewriter::new(&with(settings)).unwrap();
    rewriter.push(text.as_bytes(), &mut sink).unwrap();
    rewriter.finish(&mut sink).unwrap();
    String::from_utf8(out).unwrap()
}
