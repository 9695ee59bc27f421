//! Events and journal records in words for people, one line each.

use umi_client::journal::hex;
use umi_protocol::access::{AccessChange, AccessMode, Role};
use umi_protocol::fault::Fault;
use umi_protocol::feature::FeatureResult;
use umi_protocol::job::Approach;
use umi_protocol::latch::{LatchCause, LatchReport, Scan};
use umi_protocol::line::{HitReport, LineReport, LineStatus};
use umi_protocol::message::{Record, ResetReason, TeachBy, TeachPending, TeachSetup, TeachWhat};
use umi_protocol::program::{ProgramInfo, Release, Stated, StatedDialect};
use umi_protocol::reason::Reason;
use umi_protocol::update::UpdateState;
use umi_protocol::verdict::Verdict;

use crate::show::terminal::{
    BAD, CAUTION, FAINT, GOOD, PLAIN, Plain, Style, count, count as count_of, fixed, one_line,
    paint,
};
use crate::show::utc::utc;
use umi_client::axes::{self, Scale};
use umi_client::files::image_file::version_text;
use umi_client::quantities::{Amount, QuantityUnit, parameters};
use umi_client::timeline::{Loss, Lost};
use umi_core::rewrite::StartModes;

/// A time on the board's clock: since it started.
#[must_use]
pub fn clock(t_us: u64) -> String {
    let (seconds, us) = (t_us / 1_000_000, t_us % 1_000_000);
    let (hours, minutes) = (seconds / 3600, seconds / 60 % 60);
    format!("{hours}:{minutes:02}:{:02}.{us:06}", seconds % 60)
}

/// Bytes from a control as text: bit 7 is left out as most codes have it for
/// parity, line ends show as `\r` and `\n`, other control codes as `\x12`.
#[must_use]
pub fn printable(bytes: &[u8]) -> String {
    let text = bytes.iter().map(|byte| byte & 0x7F);
    text.map(|byte| byte.escape_ascii().to_string()).collect()
}

/// Why nothing is measured, where the end of a program that is punched does not come.
#[must_use]
pub fn punched(lines: u32) -> String {
    format!(
        "none: the control seems to punch a program ({}); `%` or a checked line ends it",
        count(lines.into(), "line")
    )
}

/// What was asked for to be taught and has not been: who asked, how long ago, by which setup.
#[must_use]
pub fn teaching(of: &TeachPending, now_us: u64) -> String {
    let by = match of.by {
        TeachBy::Host => "a host",
        TeachBy::Button => "the board's button",
        TeachBy::Line => "a line of the control (T1. or T2.)",
    };
    let ago = now_us.saturating_sub(of.t_us) / 1_000_000;
    let ago = format!("{}:{:02}:{:02}", ago / 3600, ago / 60 % 60, ago % 60);
    let teaches = match of.what {
        TeachWhat::Reference | TeachWhat::Again => "is to be the reference",
        TeachWhat::More | TeachWhat::Keep => "is to widen what was learned",
    };
    match of.setup {
        TeachSetup::Next => format!("the setup that comes next {teaches}: {by} asked {ago} ago"),
        TeachSetup::UnderWay { setup } => {
            format!("setup {setup}, under way, {teaches}: {by} asked {ago} ago")
        }
        TeachSetup::Refused { setup } => format!(
            "setup {setup} was to teach and is NG: probe the refused feature once more now, or \
             ask to teach again ({by} asked {ago} ago)"
        ),
    }
}

/// A journal record.
#[must_use]
pub fn record(record: &Record) -> String {
    let text = words(record);
    match record {
        // A reason on each line.
        Record::Verdict(_) | Record::Feature(_) => text,
        _ => one_line(text),
    }
}

fn words(record: &Record) -> String {
    match record {
        Record::Boot {
            identity,
            reset: why,
        } => format!(
            "started{}: board {} {}, firmware {}",
            reset(*why),
            identity.board,
            identity.serial,
            identity.firmware
        ),
        Record::Recovered {
            torn_bytes,
            damaged_entries,
            damaged_headers,
            chain_restarted,
        } => {
            let mut text = format!(
                "journal recovered: {torn_bytes} bytes of an unfinished entry given up, {damaged_entries} entries and {damaged_headers} sector headers damaged"
            );
            if *chain_restarted {
                text.push_str(", the chain goes on from the last entry that could be proven");
            }
            paint(CAUTION, text)
        }
        Record::JobSet { job, .. } => format!(
            "job {}: {}, {}",
            job.name,
            count(job.features.len() as u64, "feature"),
            job.correction.map_or("no correction".to_owned(), |spec| {
                format!("correction {}", spec.dialect.name())
            })
        ),
        Record::TeachAsked { keep: true, .. } => {
            "said that the setup that taught is the one that was meant".into()
        }
        Record::TeachAsked { more: false, .. } => {
            "asked to teach: the setup that comes next is to be the reference".into()
        }
        Record::TeachAsked { more: true, .. } => {
            "asked to teach more: the setup that comes next is to widen what was learned".into()
        }
        Record::ButtonHeld { refused: None } => {
            "the board's button was held: the setup that comes next is to be the reference".into()
        }
        Record::ButtonHeld {
            refused: Some(refused),
        } => paint(
            CAUTION,
            format_args!("the board's button was held, and nothing is to be taught: {refused}"),
        ),
        Record::ReferenceRestored { positions_mm, .. } => {
            format!("reference restored: {}", positions(positions_mm))
        }
        Record::Bytes { raw } => format!(
            "received {}: {}",
            count(raw.len() as u64, "byte"),
            paint(FAINT, format_args!("\"{}\"", printable(raw)))
        ),
        Record::BytesLost { count: lost } => paint(
            BAD,
            format_args!("{} lost before the receiver", count((*lost).into(), "byte")),
        ),
        Record::Time => "time-outs looked at".into(),
        Record::InputEnd => "the input ended".into(),
        Record::Fault(of) => fault(of),
        Record::FaultsAgain { latest, count } => {
            format!("{} ({count} more like the one before)", fault(latest))
        }
        Record::Access {
            what,
            key_id,
            role,
            by,
        } => {
            let key = hex(key_id);
            let by = by.map_or_else(
                || ", by the board's jumper".to_owned(),
                |by| format!(", by key {}", hex(&by)),
            );
            match what {
                AccessChange::Enrolled => format!("key {key} enrolled as {}{by}", role.name()),
                AccessChange::Revoked => format!("key {key} ({}) revoked{by}", role.name()),
                // Nobody's deed: the board has found it so.
                AccessChange::Locked if *role == Role::None => {
                    "board locked: the keys that it knew are lost".to_owned()
                }
                AccessChange::Locked => format!("board locked{by}"),
                AccessChange::Unlocked => format!("board unlocked{by}"),
            }
        }
        Record::AccessRefused { why, count, key_id } => {
            let key = key_id.map_or_else(String::new, |key| format!(", key {}", hex(&key)));
            let told = format!("refused, {}{key}: {why}", count_of((*count).into(), "time"));
            paint(CAUTION, told)
        }
        Record::Wiped {
            first_seq,
            next_seq,
            key_id,
            ..
        } => {
            let by = key_id.map_or_else(
                || "the board's jumper alone".to_owned(),
                |by| format!("key {}", hex(&by)),
            );
            let told = format!(
                "board wiped by {by}; the journal before held the entries {first_seq} to {next_seq}, without the last"
            );
            paint(CAUTION, told)
        }
        Record::Update { what, from, to } => {
            let (from, to) = (version_text(*from), version_text(*to));
            match what {
                UpdateState::Confirmed => paint(
                    GOOD,
                    format_args!("image {to} works, and is the one that starts, in place of {from}"),
                ),
                UpdateState::Reverted => paint(
                    BAD,
                    format_args!("image {to} did not confirm itself, or was changed where it stands: {from} runs"),
                ),
                UpdateState::Trial | UpdateState::None => {
                    format!("image {to} came in place of {from}, and starts on trial")
                }
            }
        }
        Record::SensorSet { sensor, .. } => match sensor {
            Some(_) => "distance sensor set up on the second port".to_owned(),
            None => "distance sensor taken away".to_owned(),
        },
        Record::Place(place) => super::sensor::place_text(place),
        Record::CaptureLost(loss) => paint(CAUTION, super::sensor::loss_text(loss)),
        Record::HostTime { utc_s, .. } => {
            format!("a host says that it is {}", utc(*utc_s))
        }
        Record::Acknowledged { seq, lost: 0 } => {
            format!("a host keeps the entries before {seq} elsewhere")
        }
        Record::Acknowledged { seq, lost } => paint(
            CAUTION,
            format_args!(
                "a host keeps the entries before {seq} elsewhere; {lost} were overwritten before anybody had kept them"
            ),
        ),
        Record::ConfigSet(of) => {
            let ceilings = match of.ceilings == umi_protocol::config::Ceilings::default() {
                true => "no ceilings",
                false => "ceilings",
            };
            let full: &str = of.journal.full.into();
            let access = match of.access == umi_protocol::config::AccessConfig::NEW {
                true => "",
                false => "; access as its owner has set",
            };
            format!("configuration in force: {ceilings}; journal full: {full}{access}")
        }
        Record::LastRun { run } => format!("the greatest run that was judged before is {run}"),
        Record::Feature(of) => feature(of),
        Record::Verdict(of) => verdict(of),
        Record::Taught { positions_mm, .. } if positions_mm.is_empty() => {
            "reference forgotten: the setup that taught it is NG after all, or another is to be taught"
                .into()
        }
        Record::Taught {
            positions_mm,
            learned,
        } => match learned.further {
            0 => format!("taught as reference: {}", positions(positions_mm)),
            further => format!(
                "limits on radius, rms and centring are wider by what {further} further \
                 clampings have shown"
            ),
        },
        Record::CorrectionSent {
            setup,
            bytes,
            complete: true,
        } => paint(
            GOOD,
            format_args!("correction of setup {setup} sent, {bytes} bytes"),
        ),
        Record::CorrectionSent {
            setup,
            bytes,
            complete: false,
        } => paint(
            BAD,
            format_args!("correction of setup {setup} broke off after {bytes} bytes"),
        ),
        Record::Latch(of) => latch(of, &Scale::default()),
        Record::Scan(of) => scan(of),
        Record::ProgramKept { program: of, .. } => format!("program {} kept", program(of)),
        Record::AlarmSent {
            number,
            why,
            bytes,
            complete,
            ..
        } => paint(
            CAUTION,
            format_args!(
                "READ of O{number:04}: {why}; alarm {}, {bytes} bytes",
                if *complete { "sent" } else { "broke off" }
            ),
        ),
        Record::ProgramSent {
            number,
            crc32,
            rewritten_for,
            bytes,
            complete,
        } => paint(
            if *complete { GOOD } else { BAD },
            format_args!(
                "program O{number:04}{} {} {bytes} bytes, check value of the original {crc32:08X}",
                rewritten(*rewritten_for),
                if *complete {
                    "sent,"
                } else {
                    "broke off after"
                }
            ),
        ),
        Record::CorrectionBegun { setup } => format!("correction of setup {setup} begins"),
        Record::ProgramBegun {
            number,
            crc32,
            rewritten_for,
        } => format!(
            "program O{number:04}{} begins, check value of the original {crc32:08X}",
            rewritten(*rewritten_for)
        ),
        Record::Head(head) => format!(
            "head: signed to here by key {}, start {} of the board",
            umi_client::journal::key_id(&head.key),
            head.boot
        ),
        Record::JobLost { why } => paint(CAUTION, format_args!("no job is in force: {why}")),
        Record::ProgramNotKept { number, why } => paint(
            CAUTION,
            format_args!("punched program O{number:04} is not kept: {why}"),
        ),
        Record::ProgramDeleted { number, crc32, .. } => {
            format!("program O{number:04} deleted, check value {crc32:08X}")
        }
    }
}

fn rewritten(rewritten_for: Option<u32>) -> String {
    rewritten_for.map_or_else(String::new, |setup| format!(" rewritten for setup {setup}"))
}

/// A part program.
#[must_use]
pub fn program(of: &ProgramInfo) -> String {
    format!(
        "O{:04} {}, {} bytes, check value {:08X}, {}{}",
        of.number,
        one_line(&of.name),
        of.bytes,
        of.crc32,
        release(&of.release),
        stated(&of.stated)
    )
}

/// When a program goes out to the control.
#[must_use]
pub const fn release(release: &Release) -> &'static str {
    match release {
        Release::AfterVerdict => "after an OK verdict",
        Release::Rewritten(_) => "rewritten after an OK verdict",
        Release::Always => "whenever asked for",
        Release::Never => "not released",
    }
}

/// The modes that a program is said to begin with, as G90.
#[must_use]
pub fn begins_in(stated: &Stated) -> Vec<String> {
    let start = StartModes::unpacked(stated.start_packed).unwrap_or_default();
    let codes = start.tenths().into_iter();
    codes
        .map(|tenths| format!("G{}", f64::from(tenths) / 10.0))
        .collect()
}

/// What was said of a program, as an addition to how it is rewritten.
#[must_use]
pub fn stated(stated: &Stated) -> String {
    let mut said = Vec::new();
    let start = begins_in(stated);
    if !start.is_empty() {
        said.push(format!("begins in {}", start.join(" ")));
    }
    match stated.dialect {
        StatedDialect::NotSaid => {}
        StatedDialect::Fanuc => said.push("as Fanuc means it".into()),
        StatedDialect::LinuxCnc => said.push("as LinuxCNC means it".into()),
    }
    if stated.allow_call > 0 {
        said.push(format!("may call O{:04}", stated.allow_call));
    }
    if said.is_empty() {
        return String::new();
    }
    format!(" ({})", said.join(", "))
}

/// Why a board started, as an addition to "started".
#[must_use]
pub const fn reset(reason: ResetReason) -> &'static str {
    match reason {
        ResetReason::Unknown => "",
        ResetReason::PowerOn => " by power",
        ResetReason::BrownOut => " after its supply was too low",
        ResetReason::Pin => " by its reset pin",
        ResetReason::Watchdog => " by its watchdog: the firmware hung",
        ResetReason::Software => " by itself",
        ResetReason::Panic => " after a failure of the firmware",
    }
}

/// Whether a start is one to look into.
#[must_use]
pub const fn reset_style(reason: ResetReason) -> Style {
    match reason {
        ResetReason::Watchdog | ResetReason::Panic => BAD,
        ResetReason::BrownOut => CAUTION,
        _ => PLAIN,
    }
}

/// What caused a latch.
#[must_use]
pub fn cause(cause: LatchCause) -> String {
    match cause {
        LatchCause::Skip => "probe".into(),
        LatchCause::SkipEnd => "probe's line fell".into(),
        LatchCause::Trigger => "trigger".into(),
        LatchCause::Output => "trigger pulse".into(),
        LatchCause::Index { axis } => format!("index mark of {}", axis_name(axis)),
    }
}

fn axis_name(axis: u8) -> String {
    let name = axes::NAMES.get(usize::from(axis));
    name.map_or_else(|| format!("axis {axis}"), |name| name.to_uppercase())
}

/// A latch, in millimetres too where the scale is known.
#[must_use]
pub fn latch(latch: &LatchReport, scale: &Scale) -> String {
    let missed = match latch.missed {
        0 => String::new(),
        n => paint(
            BAD,
            format_args!(", {} before it lost", count(n.into(), "edge")),
        ),
    };
    let mm = scale.position_mm(&latch.counts);
    let mm = if mm.is_empty() {
        String::new()
    } else {
        let mm: Vec<String> = mm.iter().map(|mm| format!("{mm:.4}")).collect();
        format!("({}) mm, ", mm.join(", "))
    };
    format!(
        "latch {} by {} at {}: {mm}counts {:?}{missed}",
        latch.number,
        cause(latch.cause),
        clock(latch.t_ns / 1000),
        latch.counts.as_slice()
    )
}

/// A line from the control.
#[must_use]
pub fn line(line: &LineReport) -> String {
    let (style, status) = match line.status {
        LineStatus::Matched => (GOOD, "with data"),
        LineStatus::Separator => (FAINT, "separator"),
        LineStatus::Program => (FAINT, "of a program"),
        LineStatus::NotUnderstood => (CAUTION, "not understood"),
        LineStatus::Damaged => (BAD, "damaged"),
        LineStatus::Request => (GOOD, "asks for a program"),
        LineStatus::Repeated => (FAINT, "repeated"),
    };
    format!(
        "line {} {}: \"{}\"",
        line.number,
        paint(style, status),
        one_line(&line.text)
    )
}

/// A hit as the control reported it.
#[must_use]
pub fn hit(hit: &HitReport) -> String {
    let [x, y, z] = hit.position_mm.map(Plain);
    let mut text = "hit".to_owned();
    if let Some(feature) = &hit.feature {
        text += &format!(" on {}", one_line(feature));
    }
    text += &format!(" at ({x:.4}, {y:.4}, {z:.4}) mm");
    if let Some(approach) = hit.approach {
        text += &format!(", moving {}", self::approach(approach));
    }
    if let Some(feed) = hit.feed_mm_per_min {
        text += &format!(", feed {feed:.0} mm/min");
    }
    text
}

/// A direction of motion.
#[must_use]
pub const fn approach(approach: Approach) -> &'static str {
    match approach {
        Approach::PlusX => "+x",
        Approach::MinusX => "-x",
        Approach::PlusY => "+y",
        Approach::MinusY => "-y",
        Approach::PlusZ => "+z",
        Approach::MinusZ => "-z",
    }
}

/// Something that is missing.
#[must_use]
pub fn loss(loss: &Loss) -> String {
    let n = u64::from(loss.count);
    let what = match loss.what {
        Lost::Edges(of) => format!(
            "{} of {} came and could not be captured",
            count(n, "edge"),
            cause(of)
        ),
        Lost::Latches(of, first) => format!(
            "{} by {} from number {first} on did not arrive",
            plural(n, "latch", "latches"),
            cause(of)
        ),
        Lost::Counted => format!(
            "{} more, by the board's counters",
            plural(n, "edge or latch", "edges or latches")
        ),
        Lost::Events => format!(
            "{} did not arrive; the journal has the records",
            count(n, "event")
        ),
        Lost::Bytes => format!("{} from the control", count(n, "byte")),
        Lost::Motion => format!(
            "motion, {} since the board started: its positions are not valid until it is started \
             anew with the axes at their reference",
            count(n, "time")
        ),
        Lost::Transitions => format!(
            "{}: positions are wrong from there on; look at the encoder and its cable",
            count(n, "illegal transition")
        ),
    };
    format!("{} {what}", paint(BAD, "lost:"))
}

fn plural(n: u64, one: &str, many: &str) -> String {
    format!("{n} {}", if n == 1 { one } else { many })
}

fn scan(scan: &Scan) -> String {
    let what = match scan.cause {
        LatchCause::Output => "trigger pulse",
        _ => "trigger",
    };
    let lost = |n: u32, what: &str| match n {
        0 => String::new(),
        n => paint(BAD, format_args!(", {n} {what}")),
    };
    format!(
        "scan: {} from number {} on, {} to {}{}{}",
        count(scan.captured.into(), what),
        scan.first,
        clock(scan.from_ns / 1000),
        clock(scan.to_ns / 1000),
        lost(scan.missed, "missed"),
        lost(scan.untold, "not told to the host"),
    )
}

/// A fault.
#[must_use]
pub fn fault(fault: &Fault) -> String {
    format!(
        "{} {fault}",
        paint(CAUTION, format_args!("fault {}:", fault.code()))
    )
}

/// A feature.
#[must_use]
pub fn feature(result: &FeatureResult) -> String {
    let status = if result.is_ok() {
        paint(GOOD, "ok")
    } else {
        paint(BAD, "refused")
    };
    let mut text = format!(
        "feature {} of setup {} {status}: {}",
        one_line(&result.name),
        result.setup,
        count(result.points_mm.len() as u64, "hit")
    );
    if let Some(fit) = &result.fit {
        let decimals = |unit| if unit == QuantityUnit::Mm { 4 } else { 6 };
        for parameter in parameters(&fit.shape).0 {
            let value = match (parameter.value, parameter.unit) {
                (Amount::Scalar(a), unit) => fixed(a, decimals(unit)),
                (Amount::Vector(of), unit) => {
                    let [x, y, z] = of.map(|value| fixed(value, decimals(unit)));
                    format!("({x}, {y}, {z})")
                }
            };
            let name = parameter.name.replace('_', " ");
            text += &format!(", {name} {value}{}", unit_word(parameter.unit));
        }
        text += &format!(", rms {:.4} mm", fit.rms_mm);
    }
    text + &list(result.reasons.iter().map(Reason::to_string))
}

/// As [`record`], and with a verdict that the board that reached it was open to everybody.
#[must_use]
pub fn guarded_record(of: &Record, mode: Option<AccessMode>) -> String {
    match (of, mode) {
        (Record::Verdict(_), Some(AccessMode::Open)) => {
            let text = record(of);
            let (first, rest) = text.split_once('\n').unwrap_or((&text, ""));
            let open = paint(CAUTION, "board open");
            let rest = if rest.is_empty() {
                String::new()
            } else {
                format!("\n{rest}")
            };
            format!("{first}, {open}{rest}")
        }
        _ => record(of),
    }
}

/// A verdict.
#[must_use]
pub fn verdict(verdict: &Verdict) -> String {
    let mut text = format!(
        "setup {}: {}",
        verdict.setup,
        if verdict.ok {
            paint(GOOD, "OK")
        } else {
            paint(BAD, "NG")
        }
    );
    if let Some(registration) = &verdict.registration {
        let [x, y, z] = registration.translation_mm.map(|mm| fixed(mm, 4));
        let [[xx, ..], [yx, ..], [.., zz]] = registration.rotation;
        // The sign of what is keyed in is told by it.
        text += &format!(
            ", turned {} deg about Z, tilted {} deg, moved ({x}, {y}, {z}) mm, rms {:.4} mm",
            fixed(yx.atan2(xx).to_degrees(), 4),
            fixed(zz.clamp(-1.0, 1.0).acos().to_degrees(), 4),
            registration.rms_mm
        );
    }
    if let Some(correction) = &verdict.correction {
        text += &format!(", correction {}", correction.dialect.name());
    }
    text += &list(verdict.reasons.iter().map(ToString::to_string));
    if verdict.reasons_dropped > 0 {
        let more = count(verdict.reasons_dropped.into(), "more reason");
        text += &list([more].into_iter());
    }
    text + &list(
        verdict
            .remarks
            .iter()
            .map(|remark| format!("remark: {remark}")),
    )
}

/// Each on a line of its own.
fn list(lines: impl Iterator<Item = String>) -> String {
    lines
        .map(|line| format!("\n    {}", one_line(line)))
        .collect()
}

const fn unit_word(unit: QuantityUnit) -> &'static str {
    match unit {
        QuantityUnit::One => "",
        QuantityUnit::Mm => " mm",
        QuantityUnit::Rad => " rad",
    }
}

fn positions(positions_mm: &[[f64; 3]]) -> String {
    let list: Vec<String> = positions_mm
        .iter()
        .map(|position| {
            let [x, y, z] = position.map(Plain);
            format!("({x:.4}, {y:.4}, {z:.4})")
        })
        .collect();
    format!("{} mm", list.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Control codes, parity and quotes of a control's text can be read and told apart.
    #[test]
    fn bytes_are_shown_as_text() {
        let sent = [0x12, b'X' | 0x80, b'-', b'"', b'\r', b'\n', 0];
        assert_eq!(printable(&sent), r#"\x12X-\"\r\n\x00"#);
    }

    fn plain(text: &str) -> String {
        umi_report::terminal::ink::plain(text)
    }

    /// A refused feature stands in one line with what was measured, and each reason
    /// below it.
    #[test]
    fn a_feature_says_what_and_why() {
        use umi_core::units::Point;
        use umi_protocol::job::FeatureKind;
        let points = [
            Point::from_mm(1.0, 0.0, 5.0),
            Point::from_mm(-1.0, 0.0, 5.0),
            Point::from_mm(0.0, 1.0, 5.0),
            Point::from_mm(0.0, 0.0, 6.0),
        ];
        let fit = umi_core::job::fit(FeatureKind::Sphere, &points).unwrap();
        let result = FeatureResult {
            index: 0,
            setup: 2,
            name: "S1".try_into().unwrap(),
            kind: FeatureKind::Sphere,
            reasons: [Reason::NullPoint { hit: 4 }].into_iter().collect(),
            points_mm: points.iter().map(|p| p.to_array_mm()).collect(),
            fit: Some(fit.report(&points)),
        };
        let text = plain(&feature(&result));
        let (line, reason) = text.split_once("\n    ").unwrap();
        assert!(
            line.starts_with("feature S1 of setup 2 refused: 4 hits, center ("),
            "{line}"
        );
        assert!(line.contains("radius 1.0000 mm, rms 0.0000 mm"), "{line}");
        assert!(reason.starts_with("hit 4 is all zeros"), "{reason}");
    }

    /// A verdict says OK or NG first, then every reason with its feature, how many
    /// found no room, and what else was noticed.
    #[test]
    fn a_verdict_says_every_reason() {
        use umi_protocol::verdict::SetupReason;
        let about = |feature: Option<&str>, reason| SetupReason {
            feature: feature.map(|name| name.try_into().unwrap()),
            reason,
        };
        let text = plain(&verdict(&Verdict {
            setup: 3,
            ok: false,
            reasons: [about(Some("S1"), Reason::SequenceGap)]
                .into_iter()
                .collect(),
            reasons_dropped: 2,
            remarks: [about(None, Reason::Taught)].into_iter().collect(),
            distances: heapless::Vec::new(),
            registration: None,
            correction: None,
        }));
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        assert_eq!(
            lines,
            [
                "setup 3: NG",
                "S1: lines are missing in the sequence; probe again",
                "2 more reasons",
                "remark: this setup is now the reference",
            ]
        );
    }

    /// The clock shows hours, minutes and microseconds.
    #[test]
    fn the_clock_counts_from_the_start() {
        assert_eq!(clock(0), "0:00:00.000000");
        assert_eq!(clock(3_725_000_042), "1:02:05.000042");
    }
}
