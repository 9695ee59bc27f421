//! A distance sensor at a board's second port: its captures, its readings and the control's lines
//! are joined on the board itself, the points are journaled, and the control hears of them.

use std::time::{Duration, Instant};

use umi_client::board::link::{Client, SensorTaken};
use umi_client::problem::Problem;
use umi_core::point::station::{ANSWER_PROGRAM, check_value};
use umi_protocol::latch::TriggerPulse;
use umi_protocol::message::Record;
use umi_protocol::point_sensor::{
    CaptureLoss, CapturedAt, PlaceReport, PlaceState, SensorOnBoard, SensorRefusal, SensorText,
    SignalLoss,
};
use umi_tests::rig::{QemuRig, SensorRig, VirtualRig};

const DC1: u8 = 0x11;
const PER_MM: f64 = 1000.0;
/// A capture that goes wrong on purpose: the reading that does not come.
const NEVER: u32 = u32::MAX;

fn sensor() -> SensorOnBoard {
    SensorOnBoard {
        offset_mm: [1.0, -1.0, -100.0],
        direction: [0.0, 0.0, -1.0],
        gain: 1.0,
        counts_per_mm: [PER_MM; 3],
        origin_counts: [0; 3],
        max_rate_hz: 9000.0,
        power_max: 5000.0,
        baud: 921_600,
        text: SensorText::default(),
        captured_at: CapturedAt::Sync,
        pulse: TriggerPulse::default(),
    }
}

/// A control, a sensor over a plane that rises by a tenth along X, and a host.
struct Shop<R> {
    rig: R,
    client: Client,
    axes_mm: [f64; 3],
    sequence: i64,
    /// The sensor's own number of its next reading.
    reading: u32,
    /// The reading that is lost.
    loses: u32,
}

impl<R: SensorRig> Shop<R> {
    fn new(mut rig: R) -> Self {
        let client = Client::new(rig.connect()).unwrap();
        Self {
            rig,
            client,
            axes_mm: [0.0; 3],
            sequence: 0,
            reading: 500,
            loses: NEVER,
        }
    }

    fn move_to(&mut self, axes_mm: [f64; 3]) {
        self.axes_mm = axes_mm;
        self.rig
            .move_to(&axes_mm.map(|mm| (mm * PER_MM).round() as i64));
    }

    /// What the sensor reads: from its zero down to the plane.
    fn gamma_mm(&self) -> f64 {
        let [x, _, z] = self.axes_mm;
        z - 100.0 - 0.1 * (x + 1.0)
    }

    /// A line as the macro prints it.
    fn line(&mut self, values: &[i64]) -> String {
        self.sequence += 1;
        let mut all = vec![self.sequence * 1000];
        all.extend(values.iter().map(|value| value * 1000));
        let check = check_value(&all);
        let letters = ["K", "A", "B", "D", "E", "F", "H"];
        let words: String = letters
            .iter()
            .zip(values)
            .map(|(letter, value)| format!("{letter} {value}.000 "))
            .collect();
        format!("\x12UMIP S  {} {words}C {check}\r\n\x14", self.sequence)
    }

    fn control_says(&mut self, values: &[i64]) {
        let line = self.line(values);
        self.rig.control_sends(line.as_bytes());
    }

    fn wait_for(&mut self, what: &str, mut is_so: impl FnMut(&mut Self) -> bool) {
        let deadline = Instant::now() + Duration::from_secs(20);
        while !is_so(self) {
            assert!(Instant::now() < deadline, "{what}");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Whether the board has answered the latest line.
    fn is_answered(&mut self) -> bool {
        let answer = self.client.sensor().unwrap().unwrap().answer;
        answer.is_some_and(|answer| i64::from(answer.sequence) == self.sequence)
    }

    /// Captures as long as the board triggers, until it has answered.
    fn capture(&mut self) {
        let deadline = Instant::now() + Duration::from_secs(60);
        loop {
            assert!(Instant::now() < deadline, "the board answers");
            if self.rig.sensor_lines().1 {
                self.rig.trigger();
                let text = format!("{:05} {:.6} 87.5 3391\r\n", self.reading, self.gamma_mm());
                if self.reading != self.loses {
                    self.rig.sensor_sends(text.as_bytes());
                }
                self.reading += 1;
            } else if self.is_answered() {
                return;
            }
        }
    }

    /// What the control reads: the program up to its closing `%`.
    fn control_reads(&mut self) -> String {
        let mut text = String::new();
        while let Some(byte) = self.rig.control_receives(Duration::from_secs(5)) {
            text.push(char::from(byte & 0x7F));
            if text.len() > 2 && text.trim_end().ends_with("\n%") {
                // The ends of lines behind it.
                while self
                    .rig
                    .control_receives(Duration::from_millis(50))
                    .is_some()
                {}
                return text;
            }
        }
        text
    }

    /// Says a line, waits at the line for the answer as `M198` does, and reads it: distance, state.
    fn served(&mut self, values: &[i64]) -> (f64, i64) {
        self.control_says(values);
        // It asks before there is anything to read.
        self.rig.control_sends(&[DC1]);
        self.capture();
        let program = self.control_reads();
        let value = |variable: &str| -> f64 {
            let line = program.lines().find(|line| line.starts_with(variable));
            let line = line.unwrap_or_else(|| panic!("{variable} in {program:?}"));
            line[variable.len()..].parse().unwrap()
        };
        assert!(
            program.contains(&format!("O{ANSWER_PROGRAM}")),
            "{program:?}"
        );
        let distance = value("#501=");
        let (state, sequence) = (value("#502=") as i64, value("#503=") as i64);
        let tenths = (distance * 1e4).round() as i64;
        let check = check_value(&[tenths, state * 1000, sequence * 1000]);
        assert_eq!(value("#504=") as i64, check, "{program:?}");
        assert_eq!(sequence, self.sequence, "never a stale answer");
        (distance, state)
    }

    /// The distance of a line that is carried out. A reading that came too late for QEMU's clock is
    /// a lost capture: the line is said again, as a macro's caller would.
    fn done(&mut self, values: &[i64]) -> f64 {
        let lost = i64::from(PlaceState::LostCapture.number());
        for _ in 0..10 {
            let (distance, state) = self.served(values);
            if !(R::CLOCK_RUNS_ON && state == lost) {
                assert_eq!(state, 1);
                return distance;
            }
        }
        panic!("ten times a reading came too late");
    }

    /// A capture where the axes are now, and its reading unless that is lost.
    fn capture_here(&mut self, is_lost: bool) {
        self.rig.trigger();
        let text = format!("{:05} {:.6} 87.5 3391\r\n", self.reading, self.gamma_mm());
        self.reading += 1;
        if is_lost {
            return;
        }
        let before = self.client.sensor().unwrap().unwrap();
        self.rig.sensor_sends(text.as_bytes());
        self.wait_for("it has read", |shop| {
            let now = shop.client.sensor().unwrap().unwrap();
            now.paired + now.lost > before.paired + before.lost
        });
    }

    /// A line of three places from X 3 on, ten captures a millimetre; of them one reading may be lost. What became of
    /// the places. Where QEMU's clock has run on too far for a reading, the line is driven again.
    fn line_of_places(&mut self, lost: u32) -> Vec<PlaceReport> {
        for _ in 0..10 {
            let before = self.places().len();
            let losses = self.losses().len();
            self.move_to([1.5, 5.0, 144.0]);
            self.control_says(&[7]);
            self.wait_for("it is on its way", Self::is_answered);
            assert!(self.rig.sensor_lines().1, "it triggers");
            for capture in 0..50 {
                // From line to line, the first half a line behind the start.
                self.move_to([1.55 + 0.1 * f64::from(capture), 5.0, 144.0]);
                self.capture_here(capture == lost);
            }
            self.control_says(&[8]);
            self.wait_for("the way has ended", Self::is_answered);
            assert!(!self.rig.sensor_lines().1, "it triggers no more");
            let more = self.losses().len() - losses;
            if more == usize::from(lost != NEVER) {
                return self.places().split_off(before);
            }
            assert!(R::CLOCK_RUNS_ON, "{:?}", self.losses());
        }
        panic!("ten times a reading came too late");
    }

    fn records<T>(&mut self, pick: impl Fn(&Record) -> Option<T>) -> Vec<T> {
        let mut found = Vec::new();
        umi_client::journal::pull(
            &mut self.client,
            umi_client::journal::PullRequest::default(),
            |step| {
                if let umi_client::journal::PullStep::Entry(entry, _) = step {
                    found.extend(pick(&umi_client::journal::record(&entry).unwrap()));
                }
                Ok::<_, Problem>(())
            },
        )
        .unwrap();
        found
    }

    fn places(&mut self) -> Vec<PlaceReport> {
        self.records(|record| match record {
            Record::Place(place) => Some(*place),
            _ => None,
        })
    }

    fn losses(&mut self) -> Vec<CaptureLoss> {
        self.records(|record| match record {
            Record::CaptureLost(loss) => Some(*loss),
            _ => None,
        })
    }
}

/// Configures the sensor and proves the beam; three places are measured then, one of them with a
/// capture whose reading does not come.
fn digitizes<R: SensorRig>(rig: R) {
    let mut shop = Shop::new(rig);
    let refused = SensorOnBoard {
        direction: [0.0, 0.0, -1.1],
        ..sensor()
    };
    let taken = shop.client.set_sensor(Some(refused)).unwrap();
    assert_eq!(taken, SensorTaken::Refused(SensorRefusal::Direction));
    let taken = shop.client.set_sensor(Some(sensor())).unwrap();
    assert_eq!(taken, SensorTaken::Done);

    // 20 captures at each place, 2000 a second.
    assert_eq!(shop.done(&[1, 2000, 2000, 20, 44, 0, 1]), 0.0);
    for z in [144.0, 144.25, 144.0] {
        shop.move_to([3.0, 5.0, z]);
        let distance = shop.done(&[2]);
        assert!((distance - (z - 100.4)).abs() < 1e-3, "{distance}");
    }
    for x in [3.0, 4.0] {
        shop.move_to([x, 5.0, 144.0]);
        shop.done(&[3]);
    }
    // One reading of the next place does not come.
    shop.loses = shop.reading + 7;
    shop.move_to([5.0, 5.0, 144.0]);
    let lost = i64::from(PlaceState::LostCapture.number());
    assert_eq!(shop.served(&[3]).1, lost);
    // It is no place beside the others: the next one is as good as any.
    shop.move_to([6.0, 5.0, 144.0]);
    shop.done(&[3]);

    let (measured, failed): (Vec<PlaceReport>, Vec<PlaceReport>) = shop
        .places()
        .into_iter()
        .partition(|place| place.state == PlaceState::Ok);
    assert!(!failed.is_empty() && (R::CLOCK_RUNS_ON || failed.len() == 1));
    for place in failed {
        assert_eq!(place.state, PlaceState::LostCapture);
        assert_eq!(place.point_mm, None, "{place:?}");
        assert!(place.lost > 0, "{place:?}");
    }
    assert_eq!(measured.len(), 3);
    for (place, x) in measured.iter().zip([3.0, 4.0, 6.0]) {
        // On the plane, under the beam.
        let at = [x + 1.0, 4.0, 0.1 * (x + 1.0)];
        let point = place.point_mm.expect("it is measured");
        for (point, at) in point.iter().zip(at) {
            assert!((point - at).abs() < 1e-5, "{place:?}");
        }
        assert_eq!((place.captures, place.outliers), (20, 0));
    }
    let losses = shop.losses();
    let is_latch = |loss: &CaptureLoss| matches!(loss, CaptureLoss::Latch { .. });
    // A board whose clock runs on while the computer is busy may miss characters of the sensor, too: it tells them.
    let are_all = R::CLOCK_RUNS_ON || losses.iter().all(is_latch);
    assert!(losses.iter().any(is_latch) && are_all, "{losses:?}");

    // The host's pulses are the sensor's now, and a line of a host is one of the control's.
    let line = shop.line(&[4]);
    let line = line.trim().bytes().filter(|byte| *byte >= b' ').collect();
    assert_eq!(shop.client.sensor_command(line).unwrap(), SensorTaken::Done);
    shop.wait_for("the host's line is answered", Shop::is_answered);

    // What is in force outlives the power.
    shop.rig.power_cycle();
    shop.client = Client::new(shop.rig.connect()).unwrap();
    let status = shop.client.sensor().unwrap().unwrap();
    assert_eq!((status.sensor, status.waits), (Some(sensor()), false));
    assert_eq!(shop.client.set_sensor(None).unwrap(), SensorTaken::Done);
    shop.rig.power_cycle();
    shop.client = Client::new(shop.rig.connect()).unwrap();
    assert_eq!(shop.client.sensor().unwrap().unwrap().sensor, None);
}

/// The skip line rises where the reading crosses its target, and stays low before.
fn trips<R: SensorRig>(rig: R) {
    let mut shop = Shop::new(rig);
    shop.client.set_sensor(Some(sensor())).unwrap();
    shop.done(&[1, 2000, 2000, 20, 44, 0, 1]);
    // Trip near: from farther away to the target of 44 mm.
    shop.move_to([0.0, 0.0, 145.1]);
    shop.control_says(&[5]);
    for (z, skip) in [(145.1, false), (144.3, false), (144.05, true)] {
        shop.move_to([0.0, 0.0, z]);
        shop.wait_for("it watches", |shop| shop.rig.sensor_lines().1);
        let paired = shop.client.sensor().unwrap().unwrap().paired + 1;
        shop.rig.trigger();
        let text = format!("{:05} {:.6} 87.5 3391\r\n", shop.reading, shop.gamma_mm());
        shop.rig.sensor_sends(text.as_bytes());
        shop.reading += 1;
        shop.wait_for("it has read", |shop| {
            shop.client.sensor().unwrap().unwrap().paired == paired
        });
        assert_eq!(shop.rig.sensor_lines().0.skip, skip, "{z}");
    }
    assert!(shop.client.sensor().unwrap().unwrap().skip);
    // The next line lets it go.
    shop.served(&[3]);
    assert!(!shop.rig.sensor_lines().0.skip);
}

/// Captures on the way, along X, of three places a millimetre apart: each place on the plane; a reading that is lost
/// takes its own place with it, and no other.
fn measures_on_the_way<R: SensorRig>(rig: R) {
    let mut shop = Shop::new(rig);
    shop.client.set_sensor(Some(sensor())).unwrap();
    shop.done(&[1, 2000, 2000, 10, 44, 0, 1]);
    // The beam is proven at rest.
    for z in [144.0, 144.25, 144.0] {
        shop.move_to([3.0, 5.0, z]);
        shop.done(&[2]);
    }
    let whole = shop.line_of_places(NEVER);
    assert_eq!(whole.len(), 3, "{whole:?}");
    for (place, x) in whole.iter().zip([3.0, 4.0, 5.0]) {
        assert_eq!(place.state, PlaceState::Ok, "{place:?}");
        let point = place.point_mm.expect("it is measured");
        for (point, at) in point.iter().zip([x + 1.0, 4.0, 0.1 * (x + 1.0)]) {
            assert!((point - at).abs() < 1e-5, "{place:?}");
        }
    }
    // The sixth reading of the second place.
    let holed = shop.line_of_places(25);
    let states: Vec<PlaceState> = holed.iter().map(|place| place.state).collect();
    let lost = PlaceState::LostCapture;
    assert_eq!(states, [PlaceState::Ok, lost, PlaceState::Ok]);
    assert_eq!(holed[1].point_mm, None);
}

/// Pulses that the board cannot send are refused to the control by name: none is waited for, and a line of them
/// is not said to be under way.
fn refuses_pulses<R: SensorRig>(rig: R) {
    let mut shop = Shop::new(rig);
    let mut set_up = sensor();
    // Longer than from one pulse to the next at 2000 Hz.
    set_up.pulse.width_us = 1000;
    shop.client.set_sensor(Some(set_up)).unwrap();
    let refused = i64::from(PlaceState::Refused.number());
    assert_eq!(shop.served(&[1, 2000, 2000, 20, 44, 0, 1]).1, refused);
    assert!(!shop.rig.sensor_lines().1 && !shop.rig.sensor_lines().0.is_ok);
    // At 500 Hz they fit.
    assert_eq!(shop.done(&[1, 500, 2000, 20, 44, 0, 1]), 0.0);
    assert!(shop.rig.sensor_lines().0.is_ok);
}

/// A sensor that is switched off, one that says nothing, and one that sees nothing: each is told, and
/// the control hears of each.
fn fails_by_name<R: SensorRig>(rig: R) {
    let mut shop = Shop::new(rig);
    assert_eq!(shop.client.sensor().unwrap().unwrap().sensor, None);
    let line = shop.line(&[4]).trim().bytes().collect();
    assert_eq!(
        shop.client.sensor_command(line).unwrap(),
        SensorTaken::Refused(SensorRefusal::NoSensor)
    );
    shop.client.set_sensor(Some(sensor())).unwrap();
    // Triggered and not captured: off.
    shop.control_says(&[1, 2000, 2000, 20, 44, 0, 1]);
    shop.rig.control_sends(&[DC1]);
    let program = shop.control_reads();
    let lost = PlaceState::LostCapture.number();
    assert!(program.contains(&format!("#502={lost}.")), "{program:?}");
    // Captured, and no word of it.
    shop.control_says(&[1, 2000, 2000, 20, 44, 0, 1]);
    shop.wait_for("it triggers", |shop| shop.rig.sensor_lines().1);
    shop.rig.trigger();
    shop.rig.control_sends(&[DC1]);
    let program = shop.control_reads();
    assert!(program.contains(&format!("#502={lost}.")), "{program:?}");
    // A word that is none, and a reading without its capture.
    shop.done(&[1, 2000, 2000, 20, 44, 0, 1]);
    shop.rig.sensor_sends(b"hello\r\n04711 44.5 90 3000\r\n");
    // Nothing is seen.
    shop.control_says(&[3]);
    for _ in 0..20 {
        shop.wait_for("it triggers", |shop| shop.rig.sensor_lines().1);
        shop.rig.trigger();
        let text = format!("{:05} - too_steep\r\n", shop.reading);
        shop.rig.sensor_sends(text.as_bytes());
        shop.reading += 1;
    }
    shop.rig.control_sends(&[DC1]);
    let steep = PlaceState::NoSignal(SignalLoss::TooSteep);
    let program = shop.control_reads();
    assert!(
        program.contains(&format!("#502={}.", steep.number())),
        "{program:?}"
    );
    let places = shop.places();
    assert_eq!(places.len(), 1);
    assert_eq!((places[0].state, places[0].point_mm), (steep, None));
    let losses = shop.losses();
    let has = |wanted: CaptureLoss| losses.contains(&wanted);
    assert!(
        has(CaptureLoss::Text) && has(CaptureLoss::Reading { reading: 4711 }),
        "{losses:?}"
    );
}

#[test]
fn the_virtual_board_digitizes() {
    digitizes(VirtualRig::start().unwrap());
}

#[test]
fn the_virtual_board_trips() {
    trips(VirtualRig::start().unwrap());
}

#[test]
fn the_virtual_board_names_what_fails() {
    fails_by_name(VirtualRig::start().unwrap());
}

#[test]
fn the_virtual_board_refuses_pulses() {
    refuses_pulses(VirtualRig::start().unwrap());
}

#[test]
fn the_virtual_board_measures_on_the_way() {
    measures_on_the_way(VirtualRig::start().unwrap());
}

#[test]
fn the_board_in_qemu_measures_on_the_way() {
    if let Some(rig) = QemuRig::start_or_skip() {
        measures_on_the_way(rig);
    }
}

#[test]
fn the_board_in_qemu_digitizes() {
    if let Some(rig) = QemuRig::start_or_skip() {
        digitizes(rig);
    }
}

#[test]
fn the_board_in_qemu_trips() {
    if let Some(rig) = QemuRig::start_or_skip() {
        trips(rig);
    }
}

#[test]
fn the_board_in_qemu_names_what_fails() {
    if let Some(rig) = QemuRig::start_or_skip() {
        fails_by_name(rig);
    }
}
