//! A point with the doubts that its digits raise.

use umi_protocol::fault::FaultKind;
use umi_protocol::pattern::{FieldFormat, Overflow, Travel};

use crate::dprnt::line::fields::Fields;
use crate::dprnt::line::number::Number;
use crate::dprnt::line::raw_line::RawLine;
use crate::dprnt::stream::sink::Sink;
use crate::dprnt::{Doubts, Item, ReportedHit};
use crate::units::Point;

/// Hands on a point, and a fault for each doubt about it.
pub(in crate::dprnt) fn emit<S: FnMut(Item<'_>)>(
    fields: &Fields,
    z_mm: f64,
    travel_mm: Option<Travel>,
    line: &RawLine<'_>,
    out: &mut Sink<'_, S>,
) {
    let ranges = travel_mm.map(Travel::to_array);
    let mut faults = [None; 7];
    let mut doubts = Doubts::NONE;
    let mut slots = faults.iter_mut();
    let mut doubt = |one, kind| {
        doubts.add(one);
        if let Some(slot) = slots.next() {
            *slot = Some(kind);
        }
    };
    for (axis, number) in (0u8..).zip(&fields.axes) {
        let Some(number) = number else { continue };
        let range = ranges.and_then(|ranges| ranges.get(usize::from(axis)).copied());
        if let Some(format) = fields
            .format
            .filter(|format| may_have_lost_digits(number, *format, range))
        {
            let integer_digits = format.integer_digits;
            doubt(
                Doubts::OVERFLOW_SUSPECT,
                FaultKind::OverflowSuspect {
                    axis,
                    integer_digits,
                },
            );
        }
        if range.is_some_and(|[least, most]| !(least..=most).contains(&number.value)) {
            doubt(Doubts::OUTSIDE_TRAVEL, FaultKind::OutsideTravel { axis });
        }
    }
    if fields
        .axes
        .iter()
        .flatten()
        .all(|number| number.mantissa == 0)
    {
        doubt(Doubts::NULL_POINT, FaultKind::NullPoint);
    }
    let [x, y, z] = fields.axes;
    let value = |number: Option<Number>, otherwise| number.map_or(otherwise, |n| n.value);
    out.hit(ReportedHit {
        line: line.number,
        first: line.first,
        last: line.last,
        position: Point::from_mm(value(x, 0.0), value(y, 0.0), value(z, z_mm)),
        digits: fields.axes.map(|number| number.map(|n| n.digits)),
        feature: fields.name.clone(),
        feature_id: fields.ids.map(|ids| ids.feature),
        index: fields.index,
        run: fields.ids.map(|ids| ids.run),
        sequence: fields.ids.map(|ids| ids.sequence),
        approach: fields.ids.and_then(|ids| ids.approach),
        touched: fields.touched,
        feed_mm_per_min: fields.feed_mm_per_min,
        doubts,
    });
    for kind in faults.into_iter().flatten() {
        out.fault(kind, line.text);
    }
}

/// Whether the control may have dropped high digits: a value with the same low
/// digits and more in front of them is within the travel too. Without a stated
/// travel: all integer digits of the format are in use.
fn may_have_lost_digits(number: &Number, format: FieldFormat, travel: Option<[f64; 2]>) -> bool {
    if format.overflow == Overflow::Expands {
        return false;
    }
    let Some([least, most]) = travel else {
        return number.digits.integer >= format.integer_digits;
    };
    // On the side of the sign: distances from zero.
    let (near, far) = if number.negative {
        (-most, -least)
    } else {
        (least, most)
    };
    let size = number.value.abs();
    let step = power_of_ten(format.integer_digits);
    let steps = libm::floor((far - size) / step);
    steps >= 1.0 && size + steps * step >= near
}

fn power_of_ten(exponent: u8) -> f64 {
    (0..exponent).fold(1.0, |power, _| power * 10.0)
}
