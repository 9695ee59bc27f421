//! A sensor that is faster than the board's processor: what does not fit is a loss by name, and no
//! reading is joined to the positions of another one.

extern crate std;

use core::cell::RefCell;
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use std::collections::VecDeque;
use std::format;
use std::string::String;
use std::vec::Vec;

use umi_core::point::station::{StationRecord, check_value};
use umi_core::units::Micros;
use umi_protocol::latch::{LatchCause, LatchReport, Positions, TriggerPulse, TriggerRefusal};
use umi_protocol::point_sensor::{CapturedAt, PlaceState, SensorOnBoard, SensorText};

use super::{PointStation, Told, sense};
use crate::board::{Axes, Clock, CncInput, SensorLines, SensorPort, SensorTrigger};

const PER_MM: f64 = 1000.0;
/// As the boards' ports have it.
const RING: usize = 1024;
/// Captures of a place: more than wait for a station.
const CAPTURES: u32 = 200;

/// What is at the port, and the time.
struct World {
    text: VecDeque<u8>,
    lost: u32,
    now_us: u64,
    triggers: bool,
    creeps: bool,
    z_mm: f64,
    reading: u32,
}

impl World {
    fn counts(&self) -> [i64; 3] {
        [0, 0, (self.z_mm * PER_MM).round() as i64]
    }

    /// The sensor captures once: its latch, and its text behind it. The axes tremble by a count
    /// along the beam: with the reading of another capture the point is off.
    fn capture(&mut self, station: &PointStation) {
        self.now_us += 111;
        if self.creeps {
            // In an order that repeats only behind 42 captures.
            let up = (self.reading / 3 + self.reading / 7).is_multiple_of(2);
            self.z_mm = 144.0 + if up { 1.0 / PER_MM } else { 0.0 };
        }
        station.latched(&LatchReport {
            number: 0,
            cause: LatchCause::Trigger,
            t_ns: self.now_us * 1000,
            counts: self.counts().into_iter().collect(),
            missed: 0,
        });
        let gamma = self.z_mm - 100.0;
        self.reading += 1;
        for byte in format!("{:05} {gamma:.6} 87.5 3391\r\n", self.reading).bytes() {
            if self.text.len() < RING {
                self.text.push_back(byte);
            } else {
                self.lost += 1;
            }
        }
    }
}

struct Port<'a>(&'a RefCell<World>);

impl Axes for Port<'_> {
    fn positions(&mut self) -> Positions {
        Positions {
            counts: self.0.borrow().counts().into_iter().collect(),
            ..Positions::default()
        }
    }
}

impl SensorPort for Port<'_> {
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput {
        poll_fn(|_| {
            let mut world = self.0.borrow_mut();
            if world.text.is_empty() {
                return match core::mem::take(&mut world.lost) {
                    0 => Poll::Pending,
                    lost => Poll::Ready(CncInput::Lost(lost)),
                };
            }
            let count = buffer.len().min(world.text.len());
            for (place, byte) in buffer.iter_mut().zip(world.text.drain(..count)) {
                *place = byte;
            }
            Poll::Ready(CncInput::Bytes(count))
        })
        .await
    }

    fn set_baud(&mut self, _: u32) {}

    fn trigger(&mut self, when: SensorTrigger, _: TriggerPulse) -> Result<(), TriggerRefusal> {
        self.0.borrow_mut().triggers = when != SensorTrigger::Off;
        Ok(())
    }

    fn show(&mut self, _: SensorLines) {}
}

struct Time<'a>(&'a RefCell<World>);

impl Clock for Time<'_> {
    fn now(&self) -> Micros {
        Micros(self.0.borrow().now_us)
    }

    async fn wait_until(&self, time: Micros) {
        poll_fn(|_| match self.now().0 >= time.0 {
            true => Poll::Ready(()),
            false => Poll::Pending,
        })
        .await;
    }
}

/// A line as the macro prints it.
fn line(sequence: i64, values: &[i64]) -> String {
    let mut all = std::vec![sequence * 1000];
    all.extend(values.iter().map(|value| value * 1000));
    let check = check_value(&all);
    let letters = ["K", "A", "B", "D", "E", "F", "H"];
    let words: String = letters
        .iter()
        .zip(values)
        .map(|(letter, value)| format!("{letter} {value}.000 "))
        .collect();
    format!("\x12UMIP S  {sequence} {words}C {check}\r\n\x14")
}

/// What a place came to, and what was told of it.
#[derive(Debug)]
struct Place {
    state: PlaceState,
    captures: u32,
    /// How far the point is off.
    off_mm: Option<f64>,
    /// Captures without a reading, readings without a capture, characters and records without room.
    losses: u32,
}

/// A place of a board whose processor has its turn each so many captures only, behind a beam that was
/// proven without haste.
fn measured(captures_at_once: u32) -> Place {
    let station = PointStation::new();
    let world = RefCell::new(World {
        text: VecDeque::new(),
        lost: 0,
        now_us: 0,
        triggers: false,
        creeps: false,
        z_mm: 144.0,
        reading: 500,
    });
    let (mut port, time) = (Port(&world), Time(&world));
    let mut task = pin!(sense(&station, &mut port, &time));
    let mut context = Context::from_waker(Waker::noop());
    let mut turn = || {
        // Until nothing is left to be read: it yields behind each piece.
        loop {
            assert!(task.as_mut().poll(&mut context).is_pending());
            if world.borrow().text.is_empty() {
                break;
            }
        }
        assert!(task.as_mut().poll(&mut context).is_pending());
    };
    station.set(Some(SensorOnBoard {
        offset_mm: [0.0, 0.0, -100.0],
        direction: [0.0, 0.0, -1.0],
        gain: 1.0,
        counts_per_mm: [PER_MM; 3],
        origin_counts: [0; 3],
        max_rate_hz: 9000.0,
        power_max: 5000.0,
        baud: 921_600,
        text: SensorText::default(),
        captured_at: CapturedAt::Sync,
        pulse: TriggerPulse {
            width_us: 10,
            ..TriggerPulse::default()
        },
    }));
    turn();
    // The measuring takes what is told at each turn.
    let told = RefCell::new(Vec::new());
    let mut sequence = 0;
    let mut say = |values: &[i64], z_mm: f64, at_once: u32, turn: &mut dyn FnMut()| {
        sequence += 1;
        world.borrow_mut().z_mm = z_mm;
        station.control_bytes(line(sequence, values).as_bytes());
        turn();
        // Longer than any reading may be late.
        for _ in 0..4000 {
            told.borrow_mut()
                .extend(core::iter::from_fn(|| station.take_told()));
            if station.take_answered() {
                return;
            }
            for _ in 0..at_once {
                if world.borrow().triggers {
                    world.borrow_mut().capture(&station);
                } else {
                    world.borrow_mut().now_us += 111;
                }
            }
            turn();
        }
        panic!("no answer to line {sequence}");
    };
    say(
        &[1, 9000, 2000, CAPTURES.into(), 44, 0, 1],
        144.0,
        1,
        &mut turn,
    );
    for z_mm in [144.0, 144.25, 144.0] {
        say(&[2], z_mm, 1, &mut turn);
    }
    told.borrow_mut().clear();
    world.borrow_mut().creeps = true;
    say(&[3], 144.0, captures_at_once, &mut turn);
    let mut losses = 0;
    let mut place = None;
    for told in told.take() {
        match told {
            Told::Record(_, StationRecord::Place(found)) => place = Some(found),
            Told::Record(..) => losses += 1,
            Told::Dropped(count) | Told::Characters(count) => losses += count,
        }
    }
    let place = place.expect("a place");
    Place {
        state: place.state,
        captures: place.captures,
        off_mm: place.point.map(|point| point.mm.z.abs()),
        losses,
    }
}

/// As many captures as the board has room for come between two turns: each is paired, none is lost.
#[test]
fn all_are_paired_where_they_have_room() {
    for at_once in [1, 8, 32] {
        let place = measured(at_once);
        assert_eq!((place.state, place.captures), (PlaceState::Ok, CAPTURES));
        assert!(place.off_mm.unwrap() < 1e-9, "{place:?}");
    }
}

/// More of them: captures, readings or both find no room. That is told. A place has a point where
/// enough of them are whole, of those alone; else none.
#[test]
fn what_is_too_fast_is_a_loss_by_name_and_no_wrong_point() {
    let mut without = 0;
    for at_once in 33..=120 {
        let place = measured(at_once);
        assert!(place.losses > 0, "{at_once}: {place:?}");
        match place.off_mm {
            Some(off_mm) => {
                assert_eq!((place.state, place.captures), (PlaceState::Ok, CAPTURES));
                assert!(off_mm < 1e-9, "{at_once}: {place:?}");
            }
            None => {
                assert_eq!(place.state, PlaceState::LostCapture, "{at_once}: {place:?}");
                without += 1;
            }
        }
    }
    assert!(without > 0, "some lose the readings of captures, too");
    std::println!("{without} of 88 without a point");
}
