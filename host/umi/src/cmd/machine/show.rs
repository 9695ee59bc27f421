//! What happens on a machine, for people and for machines.

use crate::show::terminal::Plain;
use serde_json::{Value, json};
use umi_virtual::cutting::DeviationStatistics;
use umi_virtual::machine::SkippedTouch;
use umi_virtual::nc::{Alarm, Severity};

/// An alarm.
pub fn alarm(alarm: &Alarm, file: Option<&str>) -> Value {
    json!({
        "type": match alarm.severity {
            Severity::Alarm => "alarm",
            Severity::Warning => "warning",
        },
        "file": file,
        "number": alarm.number,
        "program": alarm.program,
        "line": alarm.line,
        "column": alarm.column,
        "block": alarm.block,
        "message": alarm.message,
    })
}

/// A touch with what everyone has seen of it.
pub fn hit(number: usize, hit: &SkippedTouch) -> Value {
    json!({
        "type": "hit",
        "number": number,
        "body": hit.body,
        "t_us": hit.at.0,
        "contact_mm": hit.contact.to_array_mm(),
        "normal": hit.normal.as_slice(),
        "pretravel_mm": hit.pretravel_mm,
        "latched_mm": hit.latched.to_array_mm(),
        "counts": hit.counts,
        "delay_ms": hit.delay_ms,
        "stored_mm": hit.stored.to_array_mm(),
        "feed_mm_per_min": hit.feed_mm_per_min,
    })
}

/// A touch in one line: where the control says it was, and how far that is from the
/// place at the skip edge.
pub fn hit_line(number: usize, hit: &SkippedTouch) -> String {
    let [x, y, z] = hit.stored.to_array_mm().map(Plain);
    let late_um = (hit.stored.mm - hit.latched.mm).norm() * 1e3;
    format!(
        "{number:>4}  X {x:10.4}  Y {y:10.4}  Z {z:10.4}  F {:6.0}  {}  (control {:.2} ms and {late_um:.1} µm late)",
        hit.feed_mm_per_min, hit.body, hit.delay_ms
    )
}

/// A surface against the nominal one.
pub fn surface(surface: &DeviationStatistics) -> Value {
    json!({
        "type": "surface",
        "nodes": surface.nodes,
        "uncut": surface.uncut,
        "mean_mm": surface.mean_mm,
        "std_mm": surface.std_mm,
        "min_mm": surface.min_mm,
        "max_mm": surface.max_mm,
    })
}

/// A surface in one line.
pub fn surface_line(surface: &DeviationStatistics) -> String {
    format!(
        "mean {:+.4} mm, standard deviation {:.4}, from {:+.4} to {:+.4}; {:.1} % not cut",
        Plain(surface.mean_mm),
        surface.std_mm,
        Plain(surface.min_mm),
        Plain(surface.max_mm),
        100.0 * surface.uncut as f64 / surface.nodes as f64
    )
}

/// Text from the control's serial port as it can be shown: parity off, control
/// characters by name.
pub fn serial(bytes: &[u8]) -> String {
    let mut text = String::new();
    for byte in bytes {
        match byte & 0x7F {
            b'\n' => text.push('↵'),
            b'\r' => text.push('←'),
            0x11 => text.push_str("<DC1>"),
            0x12 => text.push_str("<DC2>"),
            0x13 => text.push_str("<DC3>"),
            0x14 => text.push_str("<DC4>"),
            other @ 0x20..=0x7E => text.push(char::from(other)),
            other => text.push_str(&format!("<{other:02X}>")),
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nothing of the traffic is invisible, and parity does not garble it.
    #[test]
    fn traffic_is_readable() {
        assert_eq!(
            serial(b"\x12X - 1.5\n\r\x14\x00"),
            "<DC2>X - 1.5↵←<DC4><00>"
        );
        assert_eq!(serial(&[0xD8, 0xA0, 0x2D, 0xB1, 0x0A]), "X -1↵");
    }
}
