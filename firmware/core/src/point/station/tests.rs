//! The station before a sensor of text and a control of lines.

use std::format;
use std::string::String;
use std::vec::Vec;

use nalgebra::Vector3;

use super::*;

const COUNTS: [i64; 3] = [10_000, -20_000, 30_000];

fn station() -> CaptureStation {
    CaptureStation::new(StationSetup {
        sensor: PointSensor {
            offset: Point::from_mm(1.0, -1.0, -100.0),
            direction: Vector3::new(0.0, 0.0, -1.0),
            gain: 1.0,
        },
        counts_per_mm: [10_000.0; 3],
        origin_counts: [0; 3],
        max_rate_hz: 9000.0,
        power_max: 4095.0,
        text: ReadingText::default(),
    })
}

fn line(sequence: i64, values: &[i64]) -> String {
    let mut all = std::vec![sequence * 1000];
    all.extend(values.iter().map(|v| v * 1000));
    let check = check_value(&all);
    let letters = ["K", "A", "B", "D", "E", "F", "H"];
    let words: String = letters
        .iter()
        .zip(values)
        .map(|(letter, value)| format!("{letter} {value}.000 "))
        .collect();
    format!("\x12UMIP S  {sequence} {words}C {check}\n\x14")
}

fn say(station: &mut CaptureStation, text: &str) {
    for byte in text.bytes() {
        station.command_byte(byte, COUNTS);
    }
}

fn read(station: &mut CaptureStation, text: &str) {
    for byte in text.bytes() {
        station.sensor_byte(byte, Micros(0));
    }
}

fn records(station: &mut CaptureStation) -> Vec<StationRecord> {
    core::iter::from_fn(|| station.take_record()).collect()
}

/// Configured for so many captures, its numbers joined at 100.
fn configured(captures: i64, guards: i64) -> CaptureStation {
    let mut station = station();
    say(
        &mut station,
        &line(1, &[1, 2000, 2000, captures, 44, guards, 1]),
    );
    assert_eq!(station.order(), CapturePulses::Time);
    station.latched(COUNTS, Micros(0));
    assert_eq!(station.order(), CapturePulses::Off);
    read(&mut station, "00100 44.5 90.0 3000\r\n");
    assert_eq!(station.take_answer().unwrap().state, PlaceState::Ok);
    station.proof = BeamProof::follows();
    station
}

fn measured(station: &mut CaptureStation) -> PlacePoint {
    match records(station).as_slice() {
        [.., StationRecord::Place(place)] => *place,
        other => panic!("no place: {other:?}"),
    }
}

#[test]
fn captures_at_rest_become_a_point() {
    let mut station = configured(3, 0);
    say(&mut station, &line(2, &[3]));
    for (n, gamma) in [44.000, 44.002, 44.004].into_iter().enumerate() {
        assert_eq!(station.order(), CapturePulses::Time);
        station.latched(COUNTS, Micros(500));
        read(&mut station, &format!("{} {gamma} 90 3000\n", 101 + n));
    }
    assert_eq!(station.order(), CapturePulses::Off);
    let place = measured(&mut station);
    assert_eq!((place.state, place.captures), (PlaceState::Ok, 3));
    assert!((place.gamma.0 - 44.002).abs() < 1e-12);
    assert!((place.spread.0 - 0.001_633).abs() < 1e-6);
    let off = place.point.unwrap().mm - Vector3::new(2.0, -3.0, 3.0 - 100.0 - 44.002);
    assert!(off.amax() < 1e-9, "{off:?}");
    let answer = station.take_answer().unwrap();
    let check = check_value(&[440_020, 1000, 2000]);
    assert_eq!(
        answer.program().as_str(),
        format!("%\nO8849\n#501=44.0020\n#502=1.\n#503=2.\n#504={check}.\nM99\n%\n")
    );
    assert!(station.take_answer().is_none(), "an answer is given once");
}

#[test]
fn no_signal_has_its_reason_and_no_point() {
    let mut station = configured(2, 0);
    say(&mut station, &line(2, &[3]));
    for n in 101..103 {
        station.latched(COUNTS, Micros(0));
        read(&mut station, &format!("{n} - too_steep\n"));
    }
    let place = measured(&mut station);
    assert_eq!(place.state, PlaceState::NoSignal(SignalLoss::TooSteep));
    assert_eq!(
        (place.point, station.take_answer().unwrap().state.number()),
        (None, 3)
    );
}

/// A reading that is lost, one that comes twice, and numbers that are off by one: none of them
/// gives a point.
#[test]
fn wrong_pairs_are_named() {
    let three = |station: &mut CaptureStation, numbers: &[u32]| {
        say(station, &line(2, &[3]));
        for _ in 0..3 {
            station.latched(COUNTS, Micros(1000));
        }
        for n in numbers {
            read(station, &format!("{n} 44.0 90 3000\n"));
        }
        station.tick(Micros(1000 + LATE_US + 1));
        records(station)
    };
    let lost = |records: &[StationRecord]| {
        records
            .iter()
            .filter(|r| matches!(r, StationRecord::Lost { .. }))
            .count()
    };
    let state = |records: &[StationRecord]| {
        records.iter().find_map(|r| match r {
            StationRecord::Place(place) => Some(place.state),
            _ => None,
        })
    };
    let good = three(&mut configured(3, 0), &[101, 102, 103]);
    assert_eq!((lost(&good), state(&good)), (0, Some(PlaceState::Ok)));
    for numbers in [
        &[101, 103][..],  // the middle one is lost
        &[101, 102],      // the last one
        &[102, 103, 104], // off by one
        &[100, 101, 102], // off by one the other way
        &[101, 101, 103], // a stale one
        &[],              // the sensor is gone
        &[900, 901, 902], // another sensor's
    ] {
        let found = three(&mut configured(3, 0), numbers);
        assert!(lost(&found) >= 1, "{numbers:?}: {found:?}");
        assert_eq!(state(&found), Some(PlaceState::LostCapture), "{numbers:?}");
    }
}

/// The axes move along the beam, and the reading must follow: a swapped sign, a stale reading.
#[test]
fn a_beam_that_does_not_follow_is_named() {
    for (second, state) in [
        (44.2, PlaceState::Ok),
        (43.8, PlaceState::BeamMismatch),
        (44.0, PlaceState::BeamMismatch),
    ] {
        let mut station = configured(1, 0);
        station.proof = BeamProof::default();
        say(&mut station, &line(2, &[2]));
        for n in 0..ADAPT_CAPTURES {
            station.latched(COUNTS, Micros(0));
            read(&mut station, &format!("{} 44.0 90 3000\n", 101 + n));
        }
        // Up by 0.2 mm, away from the surface.
        let up = [COUNTS[0], COUNTS[1], COUNTS[2] + 2000];
        say(&mut station, &line(3, &[3]));
        station.latched(up, Micros(0));
        read(&mut station, &format!("117 {second} 90 3000\n"));
        let place = measured(&mut station);
        assert_eq!(place.state, state, "{second}");
        assert_eq!(place.point.is_some(), state == PlaceState::Ok);
    }
}

/// Once the beam is proven, a reading that does not follow is an edge of the part; from the third in
/// succession on nothing else is a place until one follows again, and the twentieth is a wrong beam. So are
/// readings that are all the same where there was noise.
#[test]
fn an_edge_at_rest_is_no_wrong_beam() {
    let up = |k: i64| [COUNTS[0], COUNTS[1], COUNTS[2] + 2000 * k];
    let mut station = configured(4, 0);
    let mut number = 100;
    let mut at = |station: &mut CaptureStation, command: i64, counts, gamma: f64, noise: f64| {
        say(station, &line(command + 1, &[command]));
        for k in 0..if command == 2 { ADAPT_CAPTURES } else { 4 } {
            number += 1;
            let gamma = gamma + noise * (f64::from(k % 3) - 1.0);
            station.latched(counts, Micros(0));
            read(station, &format!("{number} {gamma:.6} 90 3000\n"));
        }
        station.take_answer().unwrap().state
    };
    // The reading jumps by 0.3 mm at each of these ways.
    let mut states = Vec::new();
    for k in 0..5 {
        states.push(at(&mut station, 2, up(k), 44.0 + 0.5 * k as f64, 0.001));
    }
    // Elsewhere: nothing is known of this one. Back, and the reading follows.
    let aside = [COUNTS[0] + 20_000, COUNTS[1], COUNTS[2] + 8000];
    states.push(at(&mut station, 2, aside, 46.0, 0.001));
    let back = [aside[0], aside[1], aside[2] + 2000];
    states.push(at(&mut station, 2, back, 46.2, 0.001));
    let (ok, edge) = (PlaceState::Ok, PlaceState::Edge);
    assert_eq!(states, [ok, edge, edge, edge, edge, edge, ok]);
    states.clear();
    for k in 0..20 {
        states.push(at(&mut station, 2, up(k), 40.0 + 0.5 * k as f64, 0.001));
    }
    assert_eq!(states[18..], [edge, edge]);
    let wrong = at(&mut station, 2, up(20), 60.0, 0.001);
    assert_eq!(wrong, PlaceState::BeamMismatch);

    let mut station = configured(4, 0);
    let mut number = 100;
    let mut states = Vec::new();
    for (command, noise) in [(2, 0.001), (3, 0.001), (3, 0.0)] {
        say(&mut station, &line(command + 1, &[command]));
        for k in 0..if command == 2 { ADAPT_CAPTURES } else { 4 } {
            number += 1;
            let gamma = 44.0 + noise * (f64::from(k % 3) - 1.0);
            station.latched(COUNTS, Micros(0));
            read(&mut station, &format!("{number} {gamma:.6} 90 3000\n"));
        }
        states.push(station.take_answer().unwrap().state);
    }
    assert_eq!(states, [ok, ok, PlaceState::BeamMismatch]);
}

/// Before anything has shown that the reading follows, a place has no point.
#[test]
fn a_beam_that_was_not_tried_gives_no_point() {
    let mut station = configured(2, 0);
    station.proof = BeamProof::default();
    say(&mut station, &line(2, &[3]));
    for n in 101..103 {
        station.latched(COUNTS, Micros(0));
        read(&mut station, &format!("{n} 44.0 90 3000\n"));
    }
    let place = measured(&mut station);
    assert_eq!((place.state, place.point), (PlaceState::BeamUnproven, None));
}

/// The same with a noisy sensor (40 µm a capture): what is right stays right, a swapped sign and
/// a standing reading are told over a way that outweighs the noise, and over a shorter one that
/// nothing is proven.
#[test]
fn a_noisy_beam_is_told_from_a_wrong_one() {
    for (way_mm, follows, state) in [
        (0.4, 1.0, PlaceState::Ok),
        (0.4, -1.0, PlaceState::BeamMismatch),
        (0.4, 0.0, PlaceState::BeamMismatch),
        (0.1, 1.0, PlaceState::BeamUnproven),
    ] {
        for seed in 0..200 {
            let mut station = configured(16, 0);
            station.proof = BeamProof::default();
            let mut number = 100;
            let mut seen = |station: &mut CaptureStation, counts, gamma: f64| {
                for _ in 0..ADAPT_CAPTURES {
                    number += 1;
                    let noise = 0.04 * noise(f64::from(number) * 0.37, seed);
                    station.latched(counts, Micros(0));
                    read(station, &format!("{number} {:.6} 90 3000\n", gamma + noise));
                }
            };
            say(&mut station, &line(2, &[2]));
            seen(&mut station, COUNTS, 44.0);
            let up = [COUNTS[0], COUNTS[1], COUNTS[2] + (way_mm * 1e4) as i64];
            say(&mut station, &line(3, &[3]));
            seen(&mut station, up, 44.0 + way_mm * follows);
            let place = measured(&mut station);
            assert_eq!(place.state, state, "{way_mm} {follows} {seed}");
            assert_eq!(place.point.is_some(), state == PlaceState::Ok);
        }
    }
}

#[test]
fn the_skip_line_follows_the_reading() {
    let mut station = configured(1, 1);
    let mut watch = |command: i64, readings: &[&str]| -> Vec<bool> {
        say(&mut station, &line(9, &[command]));
        let next = station.pairing_next();
        readings
            .iter()
            .zip(next..)
            .map(|(reading, n)| {
                station.latched(COUNTS, Micros(0));
                read(&mut station, &format!("{} {reading} 90 3000\n", n + 100));
                station.skip()
            })
            .collect()
    };
    assert_eq!(watch(5, &["44.3", "44.1", "44.0"]), [false, false, true]);
    assert_eq!(watch(6, &["43.9", "44.0", "44.06"]), [false, false, true]);
    // A signal that is lost on the way, and one that was never there.
    let gone = "- out_of_range";
    assert_eq!(
        watch(5, &["44.3", gone, gone, gone]),
        [false, false, false, true]
    );
    assert_eq!(watch(5, &[gone, gone]), [true, true]);
}

#[test]
fn broken_lines_are_refused() {
    let good = line(2, &[3]);
    for (text, fault) in [
        (good.replace("K 3", "K 2"), CommandFault::CheckValue),
        (good.replace("UMIP", "UMIQ"), CommandFault::Unreadable),
        (good.replace("K 3.000", "K"), CommandFault::Unreadable),
        (line(2, &[9]), CommandFault::Value),
        (line(3, &[1, 9001, 2000, 10, 44, 0, 1]), CommandFault::Value),
        (format!("{}\n", "X".repeat(200)), CommandFault::Unreadable),
    ] {
        let mut station = configured(1, 0);
        say(&mut station, &text);
        assert_eq!(
            records(&mut station),
            [StationRecord::Refused(fault)],
            "{text}"
        );
    }
}

/// A line of places a millimetre apart, from the left or the right: the reading at each capture is `gamma` of the way
/// since the start, in steps; some captures have another text.
fn swept(
    captures: i64,
    sign: i64,
    gamma: impl Fn(f64) -> f64,
    other: impl Fn(usize) -> Option<&'static str>,
) -> Vec<PlacePoint> {
    swept_by(configured(captures, 0), 101, sign, gamma, other)
}

/// The same by this station, whose next reading has this number.
fn swept_by(
    mut station: CaptureStation,
    first: i64,
    sign: i64,
    gamma: impl Fn(f64) -> f64,
    other: impl Fn(usize) -> Option<&'static str>,
) -> Vec<PlacePoint> {
    let captures = i64::from(station.configuration().unwrap().captures);
    say(&mut station, &line(20, &[7]));
    let CapturePulses::Distance {
        interval_counts, ..
    } = station.order()
    else {
        panic!("no pulses");
    };
    let mut found = Vec::new();
    // Four places, a step and a half on either side, and a little beyond: axes do not stop at once.
    let pulses = 6 * 10_000 / interval_counts + i64::from(captures > 1);
    for n in 0..pulses {
        let way = interval_counts / 2 + n * interval_counts;
        let [x, y, z] = COUNTS;
        station.latched([x + sign * way, y, z], Micros(n as u64 * 500));
        let number = first + n;
        let text = other(n as usize).map_or_else(
            || format!("{number} {:.6} 90 3000\n", gamma(way as f64 / 10_000.0)),
            |text| text.replace('#', &format!("{number}")),
        );
        read(&mut station, &text);
        found.extend(records(&mut station));
    }
    say(&mut station, &line(21, &[8]));
    found.extend(records(&mut station));
    let places = found.iter().filter_map(|record| match record {
        StationRecord::Place(place) => Some(*place),
        _ => None,
    });
    places.collect()
}

/// Noise without a generator: the same for each capture, of standard deviation 1.
fn noise(way: f64, seed: u64) -> f64 {
    let bits = ((way * 1e4) as u64 + (seed << 32)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let bits = (bits ^ (bits >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let bits = (bits ^ (bits >> 29)).wrapping_mul(0x94D0_49BB_1331_11EB);
    let bits = bits ^ (bits >> 32);
    ((bits >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * 12_f64.sqrt()
}

/// The reading at a place is that of the surface there, whatever its slope and curvature.
#[test]
fn captures_on_the_way_become_points() {
    let surface = |x: f64| 44.0 + 0.3 * x + 0.02 * (x - 2.0) * (x - 2.0);
    for (sign, captures) in [
        (1, 1),
        (-1, 1),
        (1, 4),
        (-1, 4),
        (1, 50),
        (-1, 50),
        (1, 100),
    ] {
        let places = swept(captures, sign, surface, |_| None);
        assert_eq!(places.len(), 4, "{captures}");
        for (k, place) in places.iter().enumerate() {
            assert_eq!((place.state, place.number), (PlaceState::Ok, k as u32));
            assert_eq!(i64::from(place.captures), captures);
            let x = 1.5 + k as f64;
            let off = place.gamma.0 - surface(x);
            assert!(off.abs() < 1e-6, "{captures} {k}: {off}");
            let at = place.axes.mm.x - 1.0 - sign as f64 * x;
            assert!(at.abs() < 1e-9, "{captures} {k}: {at}");
        }
    }
}

/// Three hundred captures of 5 um make a place of 0.43 um, and a smooth surface is nowhere an edge.
#[test]
fn captures_on_the_way_are_averaged() {
    let (lines, mut squares) = (200, 0.0);
    for seed in 0..lines {
        let places = swept(100, 1, |x| 44.0 + 0.3 * x + 5e-3 * noise(x, seed), |_| None);
        for (k, place) in places.iter().enumerate() {
            assert_eq!(place.state, PlaceState::Ok, "{seed}");
            let off = place.gamma.0 - 44.0 - 0.3 * (1.5 + k as f64);
            squares += off * off;
        }
    }
    let rms = (squares / (4 * lines) as f64).sqrt();
    assert!((0.40e-3..0.47e-3).contains(&rms), "{rms}");
}

/// A step of the surface within a step of the line gives no point there, and does not reach its neighbours.
#[test]
fn an_edge_on_the_way_is_named() {
    let surface = |x: f64| 44.0 + if x > 2.4 { 0.05 } else { 0.0 };
    let places = swept(100, 1, |x| surface(x) + 5e-3 * noise(x, 1), |_| None);
    let states: Vec<_> = places.iter().map(|place| place.state).collect();
    let ok = PlaceState::Ok;
    assert_eq!(states, [ok, PlaceState::Edge, ok, ok]);
    for (k, place) in places.iter().enumerate() {
        let off = place.gamma.0 - surface(1.5 + k as f64);
        assert!(k == 1 || off.abs() < 3e-3, "{k}: {off}");
    }
}

/// Steps, ribs and single strays of any height, anywhere, smeared over the spot or not: no point is off by more than
/// some standard deviations of one capture, whatever their number. Where the surface is smooth there are no edges.
#[test]
fn a_jump_on_the_way_moves_no_point() {
    let (mut places, mut false_edges) = (0, 0);
    let random = &mut crate::fit::tests::Random(11);
    for captures in [1, 2, 4, 5, 7, 9, 14, 25, 54, 100] {
        for seed in 0..300 {
            let [from, width, height, smear] = [(); 4].map(|()| random.unit());
            let (from, smear) = (0.5 + 5.0 * from, 0.02 * smear);
            let height = libm::pow(10.0, -1.5 + 3.0 * height) * (1.0 - 2.0 * (seed % 2) as f64);
            let to = match seed % 3 {
                0 => 9.0,
                1 => from + 0.3 * width,
                // One capture.
                _ => from + 1.0 / f64::from(captures as u8),
            };
            let sigma = 2e-3;
            let surface = |x: f64| 44.0 + 0.3 * x + 0.05 * (x - 2.0) * (x - 2.0);
            let jump = |x: f64| {
                let rise = |edge: f64| ((x - edge) / (smear + 1e-9)).clamp(0.0, 1.0);
                height * (rise(from) - rise(to))
            };
            let read = |x: f64| surface(x) + sigma * noise(x, seed);
            for (k, place) in swept(captures, 1, |x| read(x) + jump(x), |_| None)
                .iter()
                .enumerate()
            {
                let x = 1.5 + k as f64;
                // Beside an edge either side is right, and where it is smeared what is between.
                let off = [0.0, height].map(|jump| place.gamma.0 - surface(x) - jump);
                let is_between = captures < 4 && off[0] * off[1] < 0.0;
                let off = off[0].abs().min(off[1].abs());
                let is_right = is_between || off < 12.0 * sigma;
                assert!(
                    place.state != PlaceState::Ok || is_right,
                    "{captures} {seed} {k}: {off}"
                );
            }
            for place in swept(captures, 1, read, |_| None) {
                places += 1;
                false_edges += u32::from(place.state == PlaceState::Edge);
            }
        }
    }
    std::println!("{false_edges} of {places}");
    assert!(false_edges * 1000 < places, "{false_edges} of {places}");
}

/// Ribs side by side make most differences jumps, and jumps pass for noise: that at rest says otherwise. No point is in
/// mid-air, whatever the ribs.
#[test]
fn ribs_side_by_side_are_no_noise() {
    let random = &mut crate::fit::tests::Random(12);
    let (mut points, sigma) = (0, 2e-3);
    for captures in [4, 5, 6, 9, 20, 100] {
        for seed in 0..200 {
            let mut station = configured(captures, 0);
            say(&mut station, &line(2, &[2]));
            for n in 0..ADAPT_CAPTURES {
                station.latched(COUNTS, Micros(0));
                let gamma = 44.0 + sigma * noise(f64::from(n) * 0.37, seed);
                read(&mut station, &format!("{} {gamma:.6} 90 3000\n", 101 + n));
            }
            let [width, gap, height, from] = [(); 4].map(|()| random.unit());
            let (width, gap) = (0.05 + 2.0 * width, 0.05 + 2.0 * gap);
            let height = 0.2 + 5.0 * height;
            let is_rib = |x: f64| (x + 3.0 * from) % (width + gap) < width;
            let surface = |x: f64| 44.0 + if is_rib(x) { -height } else { 0.0 };
            let gamma = |x: f64| surface(x) + sigma * noise(x, seed);
            let first = 101 + i64::from(ADAPT_CAPTURES);
            for place in swept_by(station, first, 1, gamma, |_| None) {
                let off = [44.0, 44.0 - height].map(|is| (place.gamma.0 - is).abs());
                let off = off[0].min(off[1]);
                points += u32::from(place.state == PlaceState::Ok);
                assert!(
                    place.state != PlaceState::Ok || off < 25.0 * sigma,
                    "{captures} {seed}: {width} {gap} {height}: {off}"
                );
            }
        }
    }
    std::println!("{points} points");
    assert!(points > 100, "{points}");
}

/// Where the signal is gone behind the last place it is a place all the same.
#[test]
fn the_last_place_before_a_gap() {
    let gone = "# - out_of_range\n";
    // The line has 4 places; the last cell is 5 to 6 steps from its start.
    let places = swept(20, 1, |_| 44.0, |n| (n >= 100).then_some(gone));
    let states: Vec<_> = places.iter().map(|place| place.state).collect();
    assert_eq!(states, [PlaceState::Ok; 4]);
}

/// A capture on the way without reading or signal takes its place with it, and not the one beside it.
#[test]
fn a_gap_on_the_way_is_named() {
    for (text, state) in [
        ("", PlaceState::LostCapture),
        ("# - occluded\n", PlaceState::NoSignal(SignalLoss::Occluded)),
    ] {
        // The second place is 2 to 3 steps from the start.
        let places = swept(20, 1, |_| 44.0, |n| (n == 45).then_some(text));
        let states: Vec<_> = places.iter().map(|place| place.state).collect();
        assert_eq!(
            states,
            [PlaceState::Ok, state, PlaceState::Ok, PlaceState::Ok]
        );
    }
}

/// Any bytes at all: no panic, and no point from nothing.
#[test]
fn any_bytes() {
    let mut station = configured(2, 1);
    let mut seed = 1_u32;
    for _ in 0..20_000 {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let byte = b"UMIPSKABDEFHC0123456789.- \n"[(seed >> 8) as usize % 27];
        station.command_byte(byte, COUNTS);
        station.sensor_byte(byte, Micros(0));
        for record in records(&mut station) {
            assert!(!matches!(record, StationRecord::Place(_)), "{record:?}");
        }
    }
}

/// A board may tell a capture a moment after its reading has come: they are one all the same. A
/// reading that came before the edge itself belongs to no capture.
#[test]
fn a_reading_may_come_before_its_latch_is_told() {
    let mut station = configured(2, 0);
    let text = |station: &mut CaptureStation, text: &str, now: u64| {
        for byte in text.bytes() {
            station.sensor_byte(byte, Micros(now));
        }
    };
    say(&mut station, &line(2, &[3]));
    text(&mut station, "101 44 90 3000\n", 2000);
    assert!(records(&mut station).is_empty());
    station.latched(COUNTS, Micros(1900));
    text(&mut station, "102 44 90 3000\n", 2400);
    station.latched(COUNTS, Micros(2300));
    assert_eq!(measured(&mut station).state, PlaceState::Ok);

    say(&mut station, &line(3, &[3]));
    text(&mut station, "103 44 90 3000\n", 3000);
    // The edge of the next capture was later than that.
    station.latched(COUNTS, Micros(3100));
    let told = records(&mut station);
    assert!(
        matches!(told.as_slice(), [StationRecord::Unpaired { reading: 103 }]),
        "{told:?}"
    );
    station.tick(Micros(3100 + LATE_US + 1));
    let told = records(&mut station);
    assert!(
        matches!(told.as_slice(), [StationRecord::Lost { .. }]),
        "{told:?}"
    );
    assert_eq!(station.counters().lost, 1);
}

/// Pulses that were on their way when enough had come are neither captures nor losses.
#[test]
fn pulses_too_many_are_no_loss() {
    let mut station = configured(2, 0);
    say(&mut station, &line(2, &[3]));
    for _ in 0..4 {
        station.latched(COUNTS, Micros(500));
    }
    read(
        &mut station,
        "101 44 90 3000\n102 44 90 3000\n103 44 90 3000\n",
    );
    assert_eq!(measured(&mut station).captures, 2);
    // The last one never comes.
    station.tick(Micros(500 + 2 * LATE_US));
    assert!(records(&mut station).is_empty());
    // The numbers are still those of the pulses.
    say(&mut station, &line(3, &[3]));
    for number in [105, 106] {
        station.latched(COUNTS, Micros(900_000));
        read(&mut station, &format!("{number} 44 90 3000\n"));
    }
    assert_eq!(measured(&mut station).captures, 2);
}

/// An edge that the board has missed leaves its reading without a latch, and no other.
#[test]
fn a_missed_edge_shifts_nothing() {
    let mut station = configured(2, 0);
    say(&mut station, &line(2, &[3]));
    station.latched(COUNTS, Micros(0));
    read(&mut station, "101 44 90 3000\n");
    station.missed(1);
    station.latched(COUNTS, Micros(0));
    read(&mut station, "102 45 90 3000\n103 44 90 3000\n");
    let told = records(&mut station);
    let [
        StationRecord::Unpaired { reading: 102 },
        StationRecord::Place(place),
    ] = told.as_slice()
    else {
        panic!("{told:?}");
    };
    assert_eq!((place.state, place.captures), (PlaceState::Ok, 2));
    assert!((place.gamma.0 - 44.0).abs() < 1e-9);
}

/// A sensor that does not answer its trigger is told to the control, and as a place.
#[test]
fn a_sensor_that_is_off_is_told() {
    let mut station = configured(2, 0);
    say(&mut station, &line(2, &[3]));
    station.tick(Micros(1_000_000));
    station.tick(Micros(1_900_000));
    assert!(station.take_answer().is_none());
    station.tick(Micros(2_000_001));
    assert_eq!(measured(&mut station).state, PlaceState::LostCapture);
    assert_eq!(
        station.take_answer().unwrap().state,
        PlaceState::LostCapture
    );
    assert_eq!(station.order(), CapturePulses::Off);
}

/// The readings of the last captures on the way come after the line that ends it.
#[test]
fn a_way_ends_with_its_last_reading() {
    let mut station = configured(20, 0);
    say(&mut station, &line(2, &[7]));
    assert!(matches!(station.order(), CapturePulses::Distance { .. }));
    station.latched(COUNTS, Micros(0));
    say(&mut station, &line(3, &[8]));
    assert_eq!(station.order(), CapturePulses::Off);
    assert_eq!(station.take_answer(), None);
    read(&mut station, "101 44 90 3000\n");
    assert_eq!(station.take_answer().unwrap().state, PlaceState::Ok);
    assert_eq!(station.counters().lost, 0);
}
