//! Runs bytes through a receiver and keeps what comes out.

use std::string::{String, ToString as _};
use std::vec::Vec;
use std::{format, vec};

use umi_protocol::fault::{Counters, Fault, FaultCode};
use umi_protocol::line::LineStatus;
use umi_protocol::pattern::{
    BlockPattern, CheckedPattern, FieldFormat, LabelledWordsPattern, LinePattern, PointLinePattern,
    ReceiverConfig, TemplatePattern,
};

use crate::dprnt::{BlockEnd, Item, LineSplitter, ReportedHit, check_config};
use crate::units::Micros;

/// What came out.
#[derive(Debug, Default, PartialEq)]
pub struct Seen {
    pub lines: Vec<(LineStatus, String)>,
    pub hits: Vec<ReportedHit>,
    pub starts: Vec<String>,
    pub ends: Vec<BlockEnd>,
    pub faults: Vec<Fault>,
    /// Everything, in order.
    pub log: Vec<String>,
    pub counters: Counters,
}

impl Seen {
    pub fn take(&mut self, item: Item<'_>) {
        self.log.push(format!("{item:?}"));
        match item {
            Item::Line(line) => self.lines.push((line.status, line.text.to_string())),
            Item::BlockStart(start) => self.starts.push(start.name.to_string()),
            Item::Hit(hit) => self.hits.push(hit),
            Item::BlockEnd(end) => self.ends.push(end),
            // In the log.
            Item::Announced(_) | Item::Request(_) | Item::Reads => {}
            Item::Fault(fault) => self.faults.push(fault),
        }
    }

    pub fn codes(&self) -> Vec<FaultCode> {
        self.faults.iter().map(Fault::code).collect()
    }

    pub fn texts(&self) -> Vec<&str> {
        self.lines.iter().map(|(_, text)| text.as_str()).collect()
    }

    pub fn statuses(&self) -> Vec<LineStatus> {
        self.lines.iter().map(|(status, _)| *status).collect()
    }

    pub fn points(&self) -> Vec<[f64; 3]> {
        self.hits
            .iter()
            .map(|hit| hit.position.to_array_mm())
            .collect()
    }
}

/// A job's receiver part with these patterns.
pub fn config(patterns: &[LinePattern]) -> ReceiverConfig {
    let config = ReceiverConfig {
        patterns: patterns.iter().cloned().collect(),
        ..ReceiverConfig::default()
    };
    check_config(&config).unwrap();
    config
}

/// All bytes at once, then the end of the input.
pub fn run(config: &ReceiverConfig, bytes: &[u8]) -> Seen {
    run_pieces(config, &[(0, bytes)])
}

/// Pieces with the time in milliseconds at which they come, then the end.
pub fn run_pieces(config: &ReceiverConfig, pieces: &[(u64, &[u8])]) -> Seen {
    let mut receiver = LineSplitter::new(config);
    let mut seen = Seen::default();
    let mut now = Micros(0);
    for (ms, bytes) in pieces {
        now = Micros(ms * 1000);
        receiver.receive(bytes, now, &mut |item| seen.take(item));
    }
    receiver.finish(now, &mut |item| seen.take(item));
    seen.counters = *receiver.counters();
    seen
}

pub fn block() -> LinePattern {
    LinePattern::Block(BlockPattern::default())
}

pub fn point_line() -> LinePattern {
    LinePattern::PointLine(PointLinePattern::default())
}

pub fn checked() -> LinePattern {
    LinePattern::Checked(CheckedPattern::default())
}

/// Words with this prefix, these axes and these other letters.
pub fn words(prefix: &str, axes: &str, ignored: &str) -> LinePattern {
    LinePattern::LabelledWords(LabelledWordsPattern {
        prefix: prefix.try_into().unwrap(),
        axes: axes.try_into().unwrap(),
        ignored: ignored.try_into().unwrap(),
        format: None,
    })
}

pub fn template(text: &str, format: Option<FieldFormat>) -> LinePattern {
    LinePattern::Template(TemplatePattern {
        text: text.try_into().unwrap(),
        format,
    })
}

/// Text in ISO code: even parity in bit 7.
pub fn iso(text: &[u8]) -> Vec<u8> {
    let even = |b: &u8| {
        if b.count_ones() % 2 == 1 {
            b | 0x80
        } else {
            *b
        }
    };
    text.iter().map(even).collect()
}

/// Text with odd parity in bit 7.
pub fn odd(text: &[u8]) -> Vec<u8> {
    iso(text).into_iter().map(|b| b ^ 0x80).collect()
}

/// Text in EIA code; LF becomes EOB. Written from the list in RS-244, not from
/// the receiver's table.
pub fn eia(text: &[u8]) -> Vec<u8> {
    let code = |b: &u8| match b {
        b'\n' => 0x80,
        b'0' => 0x20,
        b'3' => 0x13,
        b'5' => 0x15,
        b'6' => 0x16,
        b'9' => 0x19,
        b'0'..=b'9' => b - b'0',
        b'A'..=b'I' => odd_channel_5(0x60 + (b - b'A' + 1)),
        b'J'..=b'R' => odd_channel_5(0x40 + (b - b'J' + 1)),
        b'S'..=b'Z' => odd_channel_5(0x20 + (b - b'S' + 2)),
        b' ' => 0x10,
        b'.' => 0x6B,
        b',' => 0x3B,
        b'+' => 0x70,
        b'-' => 0x40,
        b'/' => 0x31,
        b'&' => 0x0E,
        b'(' => 0x1A,
        b')' => 0x4A,
        b'%' => 0x0B,
        0x11 | 0x12 | 0x14 | 0x00 => *b,
        other => panic!("{other:#x} is not in EIA code"),
    };
    text.iter().map(code).collect()
}

/// Channel 5 makes the number of holes odd.
fn odd_channel_5(code: u8) -> u8 {
    if code.count_ones().is_multiple_of(2) {
        code | 0x10
    } else {
        code
    }
}

/// Joins byte strings.
pub fn joined(parts: &[&[u8]]) -> Vec<u8> {
    let mut all = vec![];
    for part in parts {
        all.extend_from_slice(part);
    }
    all
}
