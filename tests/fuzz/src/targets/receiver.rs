//! The DPRNT receiver against any bytes.
//!
//! The first byte of the input chooses the job, the second how the stream is cut
//! and disturbed (time-outs, losses), the rest is the stream. Held against:
//!
//! * no panic, no overflow;
//! * the same items whether the bytes come in pieces or one by one;
//! * every byte and every line in exactly one counter, every item counted;
//! * a hit only from a line that fits a pattern, with digits that stand in it;
//! * blocks begin and end in turn, and a complete one has all its points.
//!
//! The corpus holds the captures of the receiver's tests.

use std::fmt::Write as _;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::LazyLock;

use umi_core::dprnt::{
    BlockEnd, Counters, Item, LineSplitter, LineStatus, ReportedHit, check_config,
};
use umi_core::units::Micros;
use umi_protocol::pattern::{
    BlockPattern, CheckedPattern, Coding, FieldFormat, LabelledWordsPattern, LinePattern,
    PointLinePattern, ReceiverConfig, RingCsvPattern, TemplatePattern, Travel,
};

static JOBS: LazyLock<Vec<ReceiverConfig>> = LazyLock::new(jobs);

fn jobs() -> Vec<ReceiverConfig> {
    let block = LinePattern::Block(BlockPattern::default());
    let point = LinePattern::PointLine(PointLinePattern::default());
    let checked = LinePattern::Checked(CheckedPattern::default());
    let words = LinePattern::LabelledWords(LabelledWordsPattern {
        ignored: "RT".try_into().unwrap(),
        ..LabelledWordsPattern::default()
    });
    let fusion = LinePattern::LabelledWords(LabelledWordsPattern {
        prefix: "G801".try_into().unwrap(),
        axes: "X".try_into().unwrap(),
        format: Some(FieldFormat::F44),
        ..LabelledWordsPattern::default()
    });
    let ring = LinePattern::RingCsv(RingCsvPattern {
        rows: 3,
        ..RingCsvPattern::default()
    });
    let across = LinePattern::Block(BlockPattern {
        spans_sessions: true,
        ..BlockPattern::default()
    });
    let template = |text: &str| {
        LinePattern::Template(TemplatePattern {
            text: text.try_into().unwrap(),
            format: None,
        })
    };
    let parts = template("PT {i} {name} X={x} Y={y} R{skip}/{feed} T{touched}");
    let plain = template("{x}{y}{z}");
    let range = [-250.0, 300.0];
    let travel = Some(Travel {
        x: range,
        y: range,
        z: range,
    });
    let job = |coding, patterns: &[&LinePattern]| ReceiverConfig {
        coding,
        patterns: patterns.iter().map(|pattern| (*pattern).clone()).collect(),
        ..ReceiverConfig::default()
    };
    let jobs = vec![
        job(Coding::Auto, &[&block, &point, &checked, &words]),
        ReceiverConfig {
            travel_mm: travel,
            ..job(Coding::Auto, &[&fusion, &ring, &across, &parts])
        },
        job(
            Coding::Auto,
            &[
                &LinePattern::GrblProbe,
                &LinePattern::LinuxCncProbe,
                &plain,
                &block,
            ],
        ),
        job(Coding::Ascii, &[&block, &checked, &words, &ring]),
        job(Coding::IsoEven, &[&block, &words, &point]),
        job(Coding::AsciiOdd, &[&block, &words, &point]),
        job(Coding::Eia, &[&words, &block, &plain]),
    ];
    for job in &jobs {
        check_config(job).unwrap();
    }
    jobs
}

/// What came out, as a number, and what must hold on the way.
#[derive(Default)]
struct Witness {
    hash: DefaultHasher,
    line: Option<LineStatus>,
    text: String,
    digits: String,
    lines: u32,
    hits: u32,
    faults: u32,
    block_hits: u16,
    in_block: bool,
}

impl Witness {
    fn take(&mut self, item: &Item<'_>) {
        match item {
            Item::Line(line) => {
                self.lines += 1;
                assert_eq!(line.number, self.lines);
                assert!(line.text.bytes().all(|b| (0x20..0x7F).contains(&b)));
                self.line = Some(line.status);
                self.text.clear();
                self.text
                    .extend(line.text.chars().filter(|c| !matches!(c, ' ' | '*')));
                (line.byte_offset, line.status as u8, line.pattern, line.text).hash(&mut self.hash);
            }
            Item::Hit(hit) => {
                self.hits += 1;
                self.hit(hit);
            }
            Item::BlockStart(start) => {
                assert!(!self.in_block);
                self.in_block = true;
                self.block_hits = 0;
                start.name.hash(&mut self.hash);
            }
            Item::BlockEnd(end) => self.end(end),
            Item::Request(number) => number.hash(&mut self.hash),
            Item::Announced(announced) => announced.run.hash(&mut self.hash),
            Item::Reads => 17_u8.hash(&mut self.hash),
            Item::Fault(fault) => {
                self.faults += 1;
                assert!(fault.text.is_ascii());
                (fault.code() as u8, fault.line, fault.byte_offset).hash(&mut self.hash);
            }
        }
    }

    fn hit(&mut self, hit: &ReportedHit) {
        assert_eq!(self.line, Some(LineStatus::Matched));
        assert!(hit.position.is_finite());
        for (value, digits) in hit.position.to_array_mm().into_iter().zip(hit.digits) {
            value.to_bits().hash(&mut self.hash);
            let Some(digits) = digits else { continue };
            // Only what fits an f64 in decimal digits can be compared as text.
            let decimals = usize::from(digits.decimals);
            if usize::from(digits.integer) + decimals <= 15 {
                self.digits.clear();
                write!(self.digits, "{:.decimals$}", value.abs()).unwrap();
                let digits = self.digits.trim_start_matches('0');
                assert!(self.text.contains(digits), "{digits} not in {}", self.text);
            }
        }
        self.block_hits += u16::from(self.in_block && hit.feature.is_some());
    }

    fn end(&mut self, end: &BlockEnd) {
        assert!(self.in_block);
        self.in_block = false;
        assert!(!end.complete || (Some(end.got) == end.expected && end.got <= self.block_hits));
        (end.complete, end.got, end.damaged, end.ended_by as u8).hash(&mut self.hash);
    }

    /// After the end of the input.
    fn close(self, counters: &Counters, bytes: usize) -> u64 {
        assert_eq!(counters.bytes, bytes as u64);
        let parts = counters.bytes_text
            + counters.bytes_line_end
            + counters.bytes_control
            + counters.bytes_discarded;
        assert_eq!(parts, counters.bytes);
        let lines = counters.lines_matched
            + counters.lines_separator
            + counters.lines_program
            + counters.lines_not_understood
            + counters.lines_damaged;
        assert_eq!((lines, counters.lines), (self.lines, self.lines));
        assert_eq!(counters.hits, self.hits);
        assert_eq!(counters.faults.iter().sum::<u32>(), self.faults);
        assert!(!self.in_block);
        self.hash.finish()
    }
}

/// Gives the stream to a receiver, in pieces or one by one. Time-outs and losses
/// come at the same places in both cases.
fn run(job: &ReceiverConfig, control: u8, stream: &[u8], one_by_one: bool) -> u64 {
    let piece = usize::from(control & 0x1F) + 1;
    let mut receiver = LineSplitter::new(job);
    let mut witness = Witness::default();
    let mut now = Micros(0);
    for (number, bytes) in stream.chunks(piece).enumerate() {
        now.0 += 1000;
        if control & 0x20 != 0 && number % 4 == 3 {
            receiver.lost(1, now, &mut |item| witness.take(&item));
        }
        if control & 0x40 != 0 && number % 8 == 7 {
            now.0 += 1_000_000_000;
            if control & 0x80 != 0 {
                receiver.on_time(now, &mut |item| witness.take(&item));
            }
        }
        if one_by_one {
            for byte in bytes {
                receiver.push(*byte, now, &mut |item| witness.take(&item));
            }
        } else {
            receiver.receive(bytes, now, &mut |item| witness.take(&item));
        }
    }
    receiver.finish(now, &mut |item| witness.take(&item));
    assert_eq!(receiver.deadline(), None);
    witness.close(receiver.counters(), stream.len())
}

/// One input.
pub fn one(input: &[u8]) {
    let [choice, control, stream @ ..] = input else {
        return;
    };
    let Some(job) = JOBS.get(usize::from(*choice) % JOBS.len()) else {
        return;
    };
    let pieces = run(job, *control, stream, false);
    // Where nothing happens between the pieces, their size does not matter
    // either: times are not part of the hash.
    let control = if control & 0x60 == 0 { 0 } else { *control };
    assert_eq!(pieces, run(job, control, stream, true));
}
