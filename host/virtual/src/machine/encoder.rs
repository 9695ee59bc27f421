//! Incremental encoders: two square waves a quarter period apart, and an index mark.
//!
//! A count is a quarter of a period, as a counter sees it that counts every edge of both
//! waves (x4). Up, A is ahead of B:
//!
//! ```text
//! count  0 1 2 3 0 1 2 3
//!          ___     ___
//! A      _|   |___|   |_
//!            ___     ___
//! B      ___|   |___|
//! ```

/// The encoder of an axis.
///
/// ```
/// use umi_virtual::machine::Encoder;
///
/// let encoder = Encoder { counts_per_mm: 1000.0, origin_counts: 0, index_counts: 4000 };
/// let marks: Vec<f64> = encoder
///     .edges(1.0, 9.0)
///     .filter(|edge| edge.signals.index)
///     .map(|edge| edge.position_mm)
///     .collect();
/// assert_eq!(marks, [4.0, 8.0]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoder {
    /// Counts per millimetre, negative where they count down.
    pub counts_per_mm: f64,
    /// Count where the axis is at zero.
    pub origin_counts: i64,
    /// Counts between index marks; one stands at every multiple of it. 0: none.
    pub index_counts: i64,
}

/// What stands on its wires.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Signals {
    /// First wave.
    pub a: bool,
    /// Second wave.
    pub b: bool,
    /// The index mark, one count wide.
    pub index: bool,
}

/// A change of one of the waves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EncoderEdge {
    /// Where the axis was.
    pub position_mm: f64,
    /// The count from there on.
    pub count: i64,
    /// The signals from there on.
    pub signals: Signals,
}

impl Encoder {
    /// What a x4 counter holds with the axis here: the last line that was passed, not
    /// the nearest.
    #[must_use]
    pub fn counts(&self, position_mm: f64) -> i64 {
        let lines = libm::floor(position_mm * self.counts_per_mm) as i64;
        self.origin_counts.saturating_add(lines)
    }

    /// What stands on the wires at this count.
    #[must_use]
    pub fn signals(&self, count: i64) -> Signals {
        let quarter = count.rem_euclid(4);
        Signals {
            a: matches!(quarter, 1 | 2),
            b: matches!(quarter, 2 | 3),
            index: self.index_counts > 0 && count.rem_euclid(self.index_counts) == 0,
        }
    }

    /// The edges of a motion without reversal, in their order; made as they are asked
    /// for, as many as the counts differ.
    pub fn edges(&self, from_mm: f64, to_mm: f64) -> impl Iterator<Item = EncoderEdge> + use<> {
        let encoder = *self;
        let (from, to) = (self.counts(from_mm), self.counts(to_mm));
        let step = (to.saturating_sub(from)).signum();
        (1..=from.abs_diff(to)).map(move |k| {
            let count = from.wrapping_add(step.wrapping_mul(k as i64));
            // A line lies between two counts: the upper one names it.
            let line = count.max(count.wrapping_sub(step));
            EncoderEdge {
                position_mm: line.wrapping_sub(encoder.origin_counts) as f64
                    / encoder.counts_per_mm,
                count,
                signals: encoder.signals(count),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A x4 decoder that knows the waves only: the order in which they change.
    struct Decoder {
        last: (bool, bool),
        count: i64,
    }

    impl Decoder {
        fn see(&mut self, signals: Signals) {
            let now = (signals.a, signals.b);
            self.count += match (self.last.0 != now.0, self.last.1 != now.1) {
                // A changes: up if it becomes unlike B. B changes: up if it becomes like A.
                (true, false) => [-1, 1][usize::from(now.0 != now.1)],
                (false, true) => [-1, 1][usize::from(now.0 == now.1)],
                _ => panic!("not one wave changes: {:?} to {now:?}", self.last),
            };
            self.last = now;
        }
    }

    fn encoders() -> impl Iterator<Item = Encoder> {
        [
            (1000.0, 0),
            (-1000.0, 17),
            (333.3, -123_456),
            (-10_000.0, 2),
        ]
        .into_iter()
        .map(|(counts_per_mm, origin_counts)| Encoder {
            counts_per_mm,
            origin_counts,
            index_counts: 500,
        })
    }

    /// A counter on the two waves holds the counts all along a motion with reversals,
    /// whichever way the encoder counts; the edges are on the way and in its order.
    #[test]
    fn waves_decode_to_the_counts() {
        let turns = [
            0.0, 3.21, 3.2095, 3.2105, -4.7, -4.7, 0.00049, -0.0001, 12.0,
        ];
        for encoder in encoders() {
            let start = encoder.counts(turns[0]);
            let signals = encoder.signals(start);
            let mut decoder = Decoder {
                last: (signals.a, signals.b),
                count: start,
            };
            for way in turns.windows(2) {
                let (from, to) = (way[0], way[1]);
                let mut last = from;
                for edge in encoder.edges(from, to) {
                    decoder.see(edge.signals);
                    assert_eq!(decoder.count, edge.count);
                    let at = edge.position_mm;
                    let ahead = (at - last) * (to - from).signum();
                    assert!(ahead > -1e-9, "{encoder:?}: {last} to {at}");
                    assert!(at > from.min(to) - 1e-9 && at < from.max(to) + 1e-9);
                    last = at;
                    // The position's own count changes there.
                    let step = 0.1 / encoder.counts_per_mm.abs() * (to - from).signum();
                    assert_eq!(encoder.counts(at + step), edge.count);
                    assert_eq!((encoder.counts(at - step) - edge.count).abs(), 1);
                }
                assert_eq!(decoder.count, encoder.counts(to), "{encoder:?} {to}");
            }
        }
    }

    /// The index mark comes at every multiple of its pitch and nowhere else, both ways;
    /// an encoder without a pitch has none.
    #[test]
    fn index_marks_at_every_multiple() {
        for encoder in encoders() {
            let (from, to) = (-7.0127, 9.0071);
            let (low, high) = (encoder.counts(from), encoder.counts(to));
            let expected: Vec<i64> = (low.min(high)..=low.max(high))
                .filter(|count| count % 500 == 0)
                .collect();
            assert!(expected.len() > 9);
            for (from, to) in [(from, to), (to, from)] {
                let mut marks: Vec<i64> = encoder
                    .edges(from, to)
                    .filter(|edge| edge.signals.index)
                    .map(|edge| edge.count)
                    .collect();
                marks.sort_unstable();
                assert_eq!(marks, expected);
            }
        }
        let without = Encoder {
            counts_per_mm: 1000.0,
            origin_counts: 0,
            index_counts: 0,
        };
        assert!(without.edges(-7.0, 9.0).all(|edge| !edge.signals.index));
    }

    /// Edges are made as they are asked for: those of a motion as long as can be too.
    #[test]
    fn edges_are_lazy() {
        for encoder in encoders() {
            assert_eq!(encoder.edges(-1e12, 1e12).take(3).count(), 3);
            assert_eq!(encoder.edges(f64::MIN, f64::MAX).take(3).count(), 3);
            assert_eq!(encoder.edges(1.0, 1.0).count(), 0);
        }
    }
}
