//! A bench for the macros: a control of each family with its macros in memory, on an
//! ideal machine with an increment of 0.001 mm; what is printed goes through receiver
//! and job.

use std::fmt;
use std::fs;
use std::path::PathBuf;

use umi_core::brain::{Brain, Output};
use umi_core::units::Micros;
use umi_protocol::feature::{FeatureResult, Shape};
use umi_protocol::job::Job;
use umi_virtual::machine::{VirtualMachine, Wires};
use umi_virtual::nc::{Alarm, Control, ControlFamily, ControlSettings};
use umi_virtual::scene::Scene;

/// Of the ideal machine: its increment of 0.001 mm in every hit.
pub const TOLERANCE_MM: f64 = 0.002;
/// Of the macros' settings and of the probe.
pub const TIP_MM: f64 = 2.5;

/// A folder of `hw/control` whose macros can calculate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    Fanuc,
    Haas,
    MitsubishiMazak,
    LinuxCnc,
}

pub const FAMILIES: [Family; 4] = [
    Family::Fanuc,
    Family::Haas,
    Family::MitsubishiMazak,
    Family::LinuxCnc,
];

impl Family {
    pub fn folder(self) -> PathBuf {
        let name = match self {
            Self::Fanuc => "fanuc",
            Self::Haas => "haas",
            Self::MitsubishiMazak => "mitsubishi-mazak",
            Self::LinuxCnc => "linuxcnc",
        };
        PathBuf::from(env!("CARGO_MANIFEST_DIR"))
            .join("../hw/control")
            .join(name)
    }

    fn dialect(self) -> ControlFamily {
        match self {
            Self::Fanuc => ControlFamily::Fanuc,
            Self::Haas => ControlFamily::Haas,
            Self::MitsubishiMazak => ControlFamily::Mitsubishi,
            Self::LinuxCnc => ControlFamily::LinuxCnc,
        }
    }

    /// The texts of its programs, by file name.
    pub fn programs(self) -> Vec<(String, String)> {
        let mut programs: Vec<(String, String)> = fs::read_dir(self.folder())
            .expect("the family has a folder")
            .map(|entry| entry.expect("a readable folder").path())
            .filter(|path| {
                path.extension()
                    .is_some_and(|end| end == "nc" || end == "ngc")
            })
            .map(|path| {
                let name = path
                    .file_name()
                    .expect("a file")
                    .to_string_lossy()
                    .into_owned();
                (name, fs::read_to_string(path).expect("a text"))
            })
            .collect();
        programs.sort();
        programs
    }
}

/// A macro's call in both languages.
#[derive(Clone, Debug)]
pub struct Call {
    pub macro_b: String,
    pub linuxcnc: String,
}

impl Call {
    /// `G65 P…` and `O<…> CALL …` with the same values: in Macro B as `letter value`,
    /// in LinuxCNC in their order.
    pub fn new(program: u32, name: &str, values: &[(char, f64)]) -> Self {
        let letters = values
            .iter()
            .map(|(letter, value)| format!(" {letter}{value:.4}"));
        let places = values.iter().map(|(_, value)| format!(" [{value:.4}]"));
        Self {
            macro_b: format!("G65 P{program}{}", letters.collect::<String>()),
            linuxcnc: format!("O<{name}> CALL{}", places.collect::<String>()),
        }
    }

    fn of(&self, family: Family) -> &str {
        match family {
            Family::LinuxCnc => &self.linuxcnc,
            _ => &self.macro_b,
        }
    }
}

/// The serial line's end.
#[derive(Debug, Default)]
pub struct Serial(pub Vec<u8>);

impl Wires for Serial {
    fn serial(&mut self, _: Micros, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }
    fn skip(&mut self, _: Micros, _: [i64; 3]) {}
    fn time(&mut self, _: Micros) {}
}

/// What a run left.
pub struct Ran {
    pub machine: VirtualMachine<Serial>,
    pub alarm: Option<Alarm>,
}

/// Runs a macro from a start position, the tip's centre in machine coordinates.
pub fn run(family: Family, scene: &str, start_mm: [f64; 3], calls: &[Call]) -> Ran {
    let calls: Vec<&str> = calls.iter().map(|call| call.of(family)).collect();
    let [x, y, z] = start_mm;
    let begin = match family {
        Family::LinuxCnc => "O<UMI_START> CALL",
        _ => "G65 P8811",
    };
    run_text(
        family,
        scene,
        &format!(
            "G21 G17 G40 G49 G80 G90 G94 G54\n\
             G0 X{x:.3} Y{y:.3}\nG0 Z{z:.3}\n{begin}\n{}\n",
            calls.join("\n")
        ),
    )
}

/// Runs a part program's body.
pub fn run_text(family: Family, scene: &str, body: &str) -> Ran {
    run_overridden(family, scene, body, 100.0)
}

/// The same with the operator's override at another place, percent.
pub fn run_overridden(family: Family, scene: &str, body: &str, percent: f64) -> Ran {
    let mut settings = ControlSettings::of(family.dialect());
    settings.feed_override_percent = percent;
    settings.feed_mm_min = Some(1234.0);
    let mut control = Control::new(settings);
    for (name, text) in family.programs() {
        control
            .load(&text)
            .unwrap_or_else(|alarm| panic!("{name}: {alarm}"));
    }
    let main = match family {
        Family::LinuxCnc => control.load(&format!("{body}M2\n")).unwrap(),
        _ => control.load(&format!("%\nO0001\n{body}M30\n%\n")).unwrap(),
    };
    control.select(main[0]).unwrap();
    let scene = Scene::parse(scene).unwrap();
    let mut machine = VirtualMachine::new(scene, 1, Serial::default());
    let alarm = control.run(&mut machine).err();
    Ran { machine, alarm }
}

impl Ran {
    /// What was printed.
    pub fn bytes(&self) -> &[u8] {
        &self.machine.wires().0
    }

    /// The features that the job makes of what was printed.
    ///
    /// # Panics
    /// If the program ended in an alarm, or the job finds anything wrong.
    pub fn features(&self, job: &str) -> Vec<FeatureResult> {
        if let Some(alarm) = &self.alarm {
            panic!("{alarm}\n{self}");
        }
        let job: Job = toml::from_str(job).unwrap();
        let count = job.features.len();
        let mut features = Vec::new();
        let mut brain = Brain::new(job).unwrap();
        let mut take = |output: Output<'_>| match output {
            Output::Feature(feature) => features.push(feature.clone()),
            Output::Fault(fault) => panic!("{fault:?}\n{self}"),
            _ => {}
        };
        brain.bytes(Micros(1), self.bytes(), &mut take);
        assert_eq!(features.len(), count, "{self}");
        for feature in &features {
            assert!(feature.is_ok(), "{feature:?}\n{self}");
        }
        features
    }

    /// The shapes of the features.
    pub fn shapes(&self, job: &str) -> Vec<Shape> {
        let features = self.features(job);
        features
            .iter()
            .map(|feature| feature.fit.as_ref().unwrap().shape)
            .collect()
    }

    /// Holds the alarm against what the macro should say.
    pub fn refused(&self, text: &str) {
        self.refused_as(&[text]);
    }

    /// The same where it may say one of several things.
    pub fn refused_as(&self, texts: &[&str]) {
        let said = self.alarm.as_ref().filter(|alarm| is_own_alarm(alarm));
        let said = said.map(|alarm| alarm.message.to_uppercase());
        assert!(
            said.as_ref()
                .is_some_and(|said| texts.iter().any(|text| said.contains(text))),
            "wanted the alarm {texts:?}, got {:?}\n{self}",
            self.alarm
        );
    }
}

impl fmt::Display for Ran {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for hit in self.machine.hits() {
            let [x, y, z] = hit.stored.to_array_mm();
            writeln!(
                f,
                "{} at {x:.4} {y:.4} {z:.4}, F{:.0}",
                hit.body, hit.feed_mm_per_min
            )?;
        }
        f.write_str(&String::from_utf8_lossy(self.bytes()))
    }
}

/// Where the lines of a job hold tip centres.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Tip {
    /// The board adds the tip's radius along the axis of approach.
    OnBoard,
    /// Nobody adds it: the job's radius is that of the tip centre's surface.
    InRadius,
}

/// A job that only measures; features as (id, kind, hits, radius).
pub fn job(tip: Tip, features: &[(u16, &str, usize, Option<f64>)]) -> String {
    let compensation = match tip {
        Tip::OnBoard => format!(
            "{{ on_board = {{ tip_radius_mm = {TIP_MM}, pretravel_mm = [0.0, 0.0, 0.0] }} }}"
        ),
        Tip::InRadius => "\"in_macro\"".to_owned(),
    };
    let mut text = format!(
        "name = \"MACRO\"\nreference = \"taught\"\nplate_timeout_s = 100\n\
         compensation = {compensation}\n\
         [receiver]\ncoding = \"auto\"\nidle_timeout_s = 300\npatterns = [{{ checked = {{}} }}]\n\
         [receiver.travel_mm]\nx = [-500.0, 500.0]\ny = [-500.0, 500.0]\nz = [-500.0, 500.0]\n\
         [limits]\nradius_error_mm = 0.003\nrms_mm = 0.003\ndistance_error_mm = 1.0\n\
         registration_rms_mm = 1.0\nrotation_deg = 180.0\ntilt_deg = 180.0\n\
         shift_mm = [1000.0, 1000.0, 1000.0]\n"
    );
    for (id, kind, hits, radius) in features {
        text.push_str(&format!(
            "[[features]]\nname = \"F{id}\"\nid = {id}\nkind = \"{kind}\"\nhits = {hits}\n"
        ));
        if let Some(radius) = radius {
            text.push_str(&format!("radius_mm = {radius}\n"));
        }
    }
    text
}

/// Distance of two points.
pub fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// Whether a run ended in an alarm of the macros' own: `#3000` or `(ABORT,…)`.
pub fn is_own_alarm(alarm: &Alarm) -> bool {
    alarm.block.contains("#3000=") || alarm.block.contains("(ABORT,")
}

/// Evenly spread values in -1 to 1, `dimension` of them at each number (R. Richtmyer's
/// sequence: multiples of square roots of primes).
pub fn spread(number: u32, dimension: usize) -> Vec<f64> {
    [2.0f64, 3.0, 5.0, 7.0, 11.0]
        .iter()
        .take(dimension)
        .map(|prime| 2.0 * (f64::from(number) * prime.sqrt()).fract() - 1.0)
        .collect()
}
