//! What is asked of a digitizing run.

use std::fmt;

use umi_virtual::scene::{PointSensorSpec, Scene};

/// How the sensor follows the surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Strategy {
    /// At one height.
    NonAdaptive,
    /// Over to the next place at the same height, then along the beam.
    Adaptive,
    /// Over along the line through the last two points, then along the beam.
    PredictiveAdaptive,
}

impl Strategy {
    /// The letter R of the macro.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::NonAdaptive => 0,
            Self::Adaptive => 1,
            Self::PredictiveAdaptive => 2,
        }
    }

    /// The name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NonAdaptive => "non-adaptive",
            Self::Adaptive => "adaptive",
            Self::PredictiveAdaptive => "predictive-adaptive",
        }
    }
}

/// How the control hears of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeardBy {
    /// It reads a program that sets variables.
    Served,
    /// The skip input rises at the target.
    Trip,
    /// Not at all: pulses on the way.
    Pulses,
}

impl HeardBy {
    /// What `#167` of the macro is.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::Served => 0,
            Self::Trip => 1,
            Self::Pulses => 2,
        }
    }
}

/// A rectangle, and how it is to be digitized.
#[derive(Clone, Debug, PartialEq)]
pub struct DigitizeQuestion {
    /// How the sensor follows the surface (R).
    pub strategy: Strategy,
    /// The axes' first place, machine coordinates.
    pub at_mm: [f64; 3],
    /// Size along X and Y (D, E).
    pub size_mm: [f64; 2],
    /// Step along X and Y (F, H).
    pub step_mm: [f64; 2],
    /// Feed (M).
    pub feed_mm_per_min: f64,
    /// Safe height, machine Z (Q).
    pub safe_z_mm: f64,
    /// Adaptations at a place at most (U).
    pub adaptations: f64,
    /// Place in the depth of field, per cent (V).
    pub dof_position: f64,
    /// Captures a second (W).
    pub rate_hz: f64,
    /// Power of the laser (X).
    pub power: f64,
    /// Captures at a place (Z). On the way: as many a step at most, and no more than rate and feed allow.
    pub captures: f64,
    /// How the control hears of a reading.
    pub by: HeardBy,
}

/// Why there is no cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct DigitizeRefusal {
    /// The stable name.
    pub code: &'static str,
    /// The letter of the macro, if it is one's.
    pub letter: Option<char>,
    /// What is wrong and what to do.
    pub message: String,
}

impl DigitizeRefusal {
    /// A refusal that is no letter's.
    pub fn new(code: &'static str, message: impl Into<String>) -> Self {
        Self {
            code,
            letter: None,
            message: message.into(),
        }
    }

    /// A value that makes no sense, by its letter.
    pub fn letter(letter: char, message: impl fmt::Display) -> Self {
        Self {
            code: "bad_input",
            letter: Some(letter),
            message: format!("letter {letter}: {message}"),
        }
    }
}

impl fmt::Display for DigitizeRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for DigitizeRefusal {}

/// Places of one run at most: what a control's memory of a cloud is good for.
const MOST_PLACES: f64 = 1e6;

/// A control that reads a program waits so long for it; the macro asks for no more.
const ANSWER_S: f64 = 9.0;

/// Captures by which the sensor is brought to its place.
const LEAST_CAPTURES: f64 = 16.0;

/// So far from an end of the depth of field a reading still comes, per cent: at 3 from the far end of the 25 mm lens none
/// did.
const LEAST_DOF_PERCENT: f64 = 5.0;

impl DigitizeQuestion {
    /// Columns and rows.
    #[must_use]
    pub fn grid(&self) -> [usize; 2] {
        let [d, e] = self.size_mm;
        let [f, h] = self.step_mm;
        // As the macro counts.
        let count = |size: f64, step: f64| (size / step + 1e-6).floor() as usize + 1;
        [count(d, f), count(e, h)]
    }

    /// The reading to which the sensor is brought.
    #[must_use]
    pub fn target_mm(&self, sensor: &PointSensorSpec) -> f64 {
        let near = sensor.stand_off_mm - sensor.range_mm / 2.0;
        near + sensor.range_mm * self.dof_position / 100.0
    }

    /// Checks every letter, the rate and the travel, as the macro will.
    ///
    /// # Errors
    /// `bad_input` with the letter, `rate_too_high`, `over_travel`.
    pub fn check(&self, scene: &Scene, sensor: &PointSensorSpec) -> Result<(), DigitizeRefusal> {
        let [d, e] = self.size_mm;
        let [f, h] = self.step_mm;
        let within = |letter, name: &str, value: f64, least: f64, most: f64| {
            if (least..=most).contains(&value) {
                return Ok(());
            }
            Err(DigitizeRefusal::letter(
                letter,
                format_args!("the {name} is {value}; give a number from {least} to {most}"),
            ))
        };
        within('D', "size along X", d, 0.001, 1e5)?;
        within('E', "size along Y", e, 0.001, 1e5)?;
        within('F', "step along X", f, 0.01, 1e5)?;
        within('H', "step along Y", h, 0.01, 1e5)?;
        within('M', "feed in mm/min", self.feed_mm_per_min, 1.0, 30_000.0)?;
        within('U', "number of adaptations", self.adaptations, 1.0, 100.0)?;
        // At an end of the depth of field there is no signal to come to. At one height V is no place to go to.
        let is_brought = self.strategy != Strategy::NonAdaptive;
        let least = if is_brought { LEAST_DOF_PERCENT } else { 0.0 };
        within(
            'V',
            "place in the depth of field",
            self.dof_position,
            least,
            100.0 - least,
        )?;
        within('X', "power", self.power, 0.0, sensor.power_max.min(4095.0))?;
        within('Z', "number of captures", self.captures, 2.0, 9999.0)?;
        let whole = [('U', self.adaptations), ('Z', self.captures)];
        for (letter, value) in whole {
            if value.fract() != 0.0 {
                return Err(DigitizeRefusal::letter(
                    letter,
                    format_args!("{value} is no whole number"),
                ));
            }
        }
        if !self.rate_hz.is_finite() || self.rate_hz <= 0.0 {
            return Err(DigitizeRefusal::letter(
                'W',
                format_args!("the rate is {}; give a number above 0", self.rate_hz),
            ));
        }
        if self.rate_hz > sensor.max_rate_hz {
            return Err(DigitizeRefusal {
                code: "rate_too_high",
                letter: Some('W'),
                message: format!(
                    "letter W: {} captures a second are asked for, the sensor takes {} at most",
                    self.rate_hz, sensor.max_rate_hz
                ),
            });
        }
        self.rate_is_enough()?;
        if self.by == HeardBy::Pulses && self.strategy != Strategy::NonAdaptive {
            return Err(DigitizeRefusal::letter(
                'R',
                "pulses on the way do not stop to adapt: non-adaptive goes with them, or served \
                 variables or the trip with this strategy",
            ));
        }
        let [_, _, at_z] = self.at_mm;
        if !self.at_mm.iter().all(|mm| mm.is_finite()) || !self.safe_z_mm.is_finite() {
            return Err(DigitizeRefusal::letter('Q', "give finite coordinates"));
        }
        if self.safe_z_mm < at_z {
            return Err(DigitizeRefusal::letter(
                'Q',
                format_args!(
                    "the safe height {} is below the first place's {at_z}",
                    self.safe_z_mm
                ),
            ));
        }
        let [columns, rows] = [(d / f).floor() + 1.0, (e / h).floor() + 1.0];
        if columns * rows > MOST_PLACES {
            return Err(DigitizeRefusal::letter(
                'F',
                format_args!("{} places; {MOST_PLACES} at most", columns * rows),
            ));
        }
        self.within_travel(scene)
    }

    /// What a control hears of in time, or what a way shows.
    fn rate_is_enough(&self) -> Result<(), DigitizeRefusal> {
        let [step_mm, _] = self.step_mm;
        let a_step = self.rate_hz * step_mm * 60.0 / self.feed_mm_per_min;
        if self.by == HeardBy::Pulses && a_step < 1.0 {
            return Err(DigitizeRefusal::letter(
                'W',
                format_args!(
                    "{} captures a second are {a_step:.2} a step: give a higher rate, a longer step, or a lower feed",
                    self.rate_hz
                ),
            ));
        }
        let longest_s = self.captures.max(LEAST_CAPTURES) / self.rate_hz;
        if self.by == HeardBy::Served && longest_s > ANSWER_S {
            return Err(DigitizeRefusal::letter(
                'W',
                format_args!(
                    "{} captures at {} a second take {longest_s:.1} s, and a control waits {ANSWER_S} s for an \
                     answer: give a higher rate or fewer captures, or --by trip",
                    self.captures.max(LEAST_CAPTURES),
                    self.rate_hz
                ),
            ));
        }
        Ok(())
    }

    fn within_travel(&self, scene: &Scene) -> Result<(), DigitizeRefusal> {
        let machine = &scene.machine;
        let ([x, y, z], [d, e], [f, _]) = (self.at_mm, self.size_mm, self.step_mm);
        // On the way a line begins and ends a step and a half beside its places.
        let beside = if self.by == HeardBy::Pulses {
            1.5 * f
        } else {
            0.0
        };
        let wanted = [
            [x - beside, x + d + beside],
            [y, y + e],
            [z, self.safe_z_mm],
        ];
        let limits = machine.travel_min_mm.iter().zip(&machine.travel_max_mm);
        for ((axis, ends), (least, most)) in ["X", "Y", "Z"].iter().zip(wanted).zip(limits) {
            for mm in ends {
                if !(*least..=*most).contains(&mm) {
                    return Err(DigitizeRefusal::new(
                        "over_travel",
                        format!(
                            "over-travel: {axis} {mm:.3} is outside {least} to {most} (machine \
                             coordinates, mm)"
                        ),
                    ));
                }
            }
        }
        Ok(())
    }
}
