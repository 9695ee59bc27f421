//! Reading a session's text: the coordinates of every point in it.

use regex::bytes::Regex;
use umi_core::dprnt::{Item, LineSplitter, ReceiverConfig};
use umi_core::units::Micros;
use umi_protocol::pattern::{BlockPattern, LinePattern};

use crate::data::Data;
use crate::{Contender, Work};

const TASK: &str = "DPRNT text of a session";

/// Everyone who reads DPRNT text.
pub fn contenders(data: &Data) -> [Contender; 2] {
    let contender = |by, work: fn(&[u8]) -> Work| Contender {
        task: TASK,
        by,
        bytes: Some(data.session.len()),
        work: work(&data.session),
    };
    [contender("umi-core", by_umi), contender("regex", by_regex)]
}

fn by_umi(text: &[u8]) -> Work {
    let text = text.to_vec();
    let config = ReceiverConfig {
        patterns: [LinePattern::Block(BlockPattern::default())]
            .into_iter()
            .collect(),
        ..ReceiverConfig::default()
    };
    Box::new(move |answer| {
        answer.clear();
        let mut sink = |item: Item<'_>| {
            if let Item::Hit(hit) = item {
                answer.extend(hit.position.to_array_mm());
            }
        };
        let mut receiver = LineSplitter::new(&config);
        receiver.receive(&text, Micros(0), &mut sink);
        receiver.finish(Micros(0), &mut sink);
    })
}

/// A script on the crate `regex`: lines of three numbers, and nothing else. It knows no
/// blocks, no parity, no doubts, and drops without a word what does not match.
fn by_regex(text: &[u8]) -> Work {
    let text = text.to_vec();
    let number = r"([+-]?)[ *]*(\d*\.\d*)";
    let line = format!(r"(?m)^[ *]*{number}[ *]*{number}[ *]*{number}\s*$");
    let line = Regex::new(&line);
    Box::new(move |answer| {
        answer.clear();
        let Ok(line) = &line else { return };
        for fields in line.captures_iter(&text) {
            let (_, [sx, x, sy, y, sz, z]) = fields.extract();
            for (sign, digits) in [(sx, x), (sy, y), (sz, z)] {
                let value = std::str::from_utf8(digits)
                    .ok()
                    .and_then(|digits| digits.parse::<f64>().ok());
                answer.extend(value.map(|value| if sign == b"-" { -value } else { value }));
            }
        }
    })
}
