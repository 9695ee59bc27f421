//! A board's configuration: what its owner allows, whatever a job asks for.

use core::ops::RangeInclusive;

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::{EnumCount, IntoStaticStr, VariantArray};

use crate::job::Job;
use crate::job::job_error::{Field, JobError};

/// What the owner allows. In a file each field may be left out: then it is as on a new board.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(default, deny_unknown_fields)]
pub struct BoardConfig {
    /// How wide a job may be.
    pub ceilings: Ceilings,
    /// What the journal does when it is full.
    pub journal: JournalConfig,
    /// What keys and the board's button may do, within what the roles allow. What is added stands
    /// last and is zeros on a new board: so a record of before is read
    /// ([`crate::message::Record::ConfigSet`]).
    pub access: AccessConfig,
}

impl BoardConfig {
    /// Of a new board.
    pub const NEW: Self = Self {
        ceilings: Ceilings::NONE,
        journal: JournalConfig {
            full: WhenFull::Overwrite,
        },
        access: AccessConfig::NEW,
    };
}

impl Default for BoardConfig {
    fn default() -> Self {
        Self::NEW
    }
}

/// The widest limits that a job may have: a job with a wider one is not taken, whoever sets it.
/// None: any.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(default, deny_unknown_fields)]
pub struct Ceilings {
    /// Of `limits.radius_error_mm`.
    pub radius_error_mm: Option<f64>,
    /// Of `limits.rms_mm`.
    pub rms_mm: Option<f64>,
    /// Of `limits.distance_error_mm`.
    pub distance_error_mm: Option<f64>,
    /// Of `limits.registration_rms_mm`.
    pub registration_rms_mm: Option<f64>,
    /// Of `limits.rotation_deg`.
    pub rotation_deg: Option<f64>,
    /// Of `limits.tilt_deg`.
    pub tilt_deg: Option<f64>,
    /// Of each axis of `limits.shift_mm`.
    pub shift_mm: Option<f64>,
    /// Of `limits.expected_error_mm`, which a job must have then.
    pub expected_error_mm: Option<f64>,
    /// A job must have a second witness of each hit (`[witness]`).
    pub require_witness: bool,
    /// Programs may go out "whenever asked for", without a verdict.
    pub always: bool,
}

impl Ceilings {
    /// Of a new board: none.
    pub const NONE: Self = Self {
        radius_error_mm: None,
        rms_mm: None,
        distance_error_mm: None,
        registration_rms_mm: None,
        rotation_deg: None,
        tilt_deg: None,
        shift_mm: None,
        expected_error_mm: None,
        require_witness: false,
        always: true,
    };
}

impl Default for Ceilings {
    fn default() -> Self {
        Self::NONE
    }
}

/// The journal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(default, deny_unknown_fields)]
pub struct JournalConfig {
    /// Evidence that nobody has acknowledged is about to be overwritten.
    pub full: WhenFull,
}

/// What a board does then.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema, IntoStaticStr,
)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum WhenFull {
    /// It overwrites the oldest, counts it and says so.
    #[default]
    Overwrite,
    /// It sends no correction and no program that needs a verdict.
    Refuse,
}

/// What keys and the board's button may do, within what the roles allow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(default, deny_unknown_fields)]
pub struct AccessConfig {
    /// Who reads a board that its owner has locked.
    pub locked_reading: LockedReading,
    /// A session ends when its host has asked nothing for so many seconds; none: it ends with the
    /// connection.
    pub session_idle_s: Option<u32>,
    /// The board's button asks for no teaching: only who has an engineer's key does, and the
    /// control's own lines.
    pub button_off: bool,
}

/// Who reads a board that its owner has locked.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema, IntoStaticStr,
)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum LockedReading {
    /// Who has a key, of an operator at least.
    #[default]
    Operators,
    /// Nobody, before an owner unlocks it.
    Nobody,
}

/// What [`AccessConfig::session_idle_s`] may be: a host that works asks more often than the least.
pub const SESSION_IDLE_S: RangeInclusive<u32> = 10..=86_400;

impl AccessConfig {
    /// Of a new board.
    pub const NEW: Self = Self {
        locked_reading: LockedReading::Operators,
        session_idle_s: None,
        button_off: false,
    };

    fn has_bad_idle(&self) -> bool {
        let given = self.session_idle_s;
        given.is_some_and(|given| !SESSION_IDLE_S.contains(&given))
    }

    /// For so long a session lives without a request, microseconds. What is too short to be worked
    /// with is the least that is not.
    #[must_use]
    pub fn session_idle_us(&self) -> u64 {
        self.session_idle_s.map_or(u64::MAX, |given| {
            u64::from(given.max(*SESSION_IDLE_S.start())) * 1_000_000
        })
    }
}

/// A field of the configuration, by its name.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    Schema,
    EnumCount,
    IntoStaticStr,
    VariantArray,
)]
#[postcard(crate = crate)]
#[allow(missing_docs, reason = "each is the field of the same name")]
pub enum ConfigField {
    #[strum(serialize = "ceilings.radius_error_mm")]
    RadiusErrorMm,
    #[strum(serialize = "ceilings.rms_mm")]
    RmsMm,
    #[strum(serialize = "ceilings.distance_error_mm")]
    DistanceErrorMm,
    #[strum(serialize = "ceilings.registration_rms_mm")]
    RegistrationRmsMm,
    #[strum(serialize = "ceilings.rotation_deg")]
    RotationDeg,
    #[strum(serialize = "ceilings.tilt_deg")]
    TiltDeg,
    #[strum(serialize = "ceilings.shift_mm")]
    ShiftMm,
    #[strum(serialize = "ceilings.expected_error_mm")]
    ExpectedErrorMm,
    #[strum(serialize = "ceilings.require_witness")]
    RequireWitness,
    #[strum(serialize = "ceilings.always")]
    Always,
    #[strum(serialize = "journal.full")]
    Full,
    #[strum(serialize = "access.locked_reading")]
    LockedReading,
    #[strum(serialize = "access.session_idle_s")]
    SessionIdleS,
    #[strum(serialize = "access.button_off")]
    ButtonOff,
}

/// How many fields there are.
pub const FIELDS: usize = <ConfigField as EnumCount>::COUNT;

/// Fields that could not be read where they are kept: each is as strict as it can be.
pub type Fallbacks = Vec<ConfigField, FIELDS>;

impl ConfigField {
    /// All of them.
    pub const ALL: &[Self] = <Self as VariantArray>::VARIANTS;

    /// Its name: the table and the field.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl Ceilings {
    fn numbers(&mut self) -> [(ConfigField, &mut Option<f64>); 8] {
        [
            (ConfigField::RadiusErrorMm, &mut self.radius_error_mm),
            (ConfigField::RmsMm, &mut self.rms_mm),
            (ConfigField::DistanceErrorMm, &mut self.distance_error_mm),
            (
                ConfigField::RegistrationRmsMm,
                &mut self.registration_rms_mm,
            ),
            (ConfigField::RotationDeg, &mut self.rotation_deg),
            (ConfigField::TiltDeg, &mut self.tilt_deg),
            (ConfigField::ShiftMm, &mut self.shift_mm),
            (ConfigField::ExpectedErrorMm, &mut self.expected_error_mm),
        ]
    }

    /// Whether a job keeps below all of them.
    ///
    /// # Errors
    /// [`JobError::BeyondCeiling`], [`JobError::WitnessDemanded`].
    pub fn check(&self, job: &Job) -> Result<(), JobError> {
        let limits = &job.limits;
        let [x, y, z] = limits.shift_mm;
        for (field, given, ceiling) in [
            (
                Field::RadiusErrorMm,
                Some(limits.radius_error_mm),
                self.radius_error_mm,
            ),
            (Field::RmsMm, Some(limits.rms_mm), self.rms_mm),
            (
                Field::DistanceErrorMm,
                Some(limits.distance_error_mm),
                self.distance_error_mm,
            ),
            (
                Field::RegistrationRmsMm,
                Some(limits.registration_rms_mm),
                self.registration_rms_mm,
            ),
            (
                Field::RotationDeg,
                Some(limits.rotation_deg),
                self.rotation_deg,
            ),
            (Field::TiltDeg, Some(limits.tilt_deg), self.tilt_deg),
            (Field::ShiftMm, Some(x.max(y).max(z)), self.shift_mm),
            (
                Field::ExpectedErrorMm,
                limits.expected_error_mm,
                self.expected_error_mm,
            ),
        ] {
            if let Some(ceiling) = ceiling
                // What is not a number is above it, too.
                && !given.is_some_and(|given| given <= ceiling)
            {
                return Err(JobError::BeyondCeiling {
                    field,
                    ceiling,
                    given,
                });
            }
        }
        if self.require_witness && job.witness.is_none() {
            return Err(JobError::WitnessDemanded);
        }
        Ok(())
    }
}

impl BoardConfig {
    /// Whether it can be used.
    ///
    /// # Errors
    /// The first field that cannot: a ceiling that is no number above zero, a time that is not
    /// within [`SESSION_IDLE_S`].
    pub fn check(&self) -> Result<(), ConfigField> {
        let mut copy = *self;
        match copy.strict_where_bad().first() {
            Some(field) => Err(*field),
            None => Ok(()),
        }
    }

    /// Makes each field that cannot be used as strict as it can be, and says which these are. They
    /// cannot be used then either: no job fits, until the owner has set another.
    pub fn strict_where_bad(&mut self) -> Fallbacks {
        let mut bad = Fallbacks::new();
        for (field, number) in self.ceilings.numbers() {
            if number.is_some_and(|value| !(value.is_finite() && value > 0.0)) {
                *number = Some(0.0);
                // There is room for every field.
                let _ = bad.push(field);
            }
        }
        if self.access.has_bad_idle() {
            self.access.session_idle_s = Some(0);
            let _ = bad.push(ConfigField::SessionIdleS);
        }
        bad
    }

    /// As strict as it can be, where nothing of what was set can be read: no job fits, and
    /// nothing goes out, until the owner has set it anew.
    #[must_use]
    pub const fn strictest() -> Self {
        let none = Some(0.0);
        Self {
            ceilings: Ceilings {
                radius_error_mm: none,
                rms_mm: none,
                distance_error_mm: none,
                registration_rms_mm: none,
                rotation_deg: none,
                tilt_deg: none,
                shift_mm: none,
                expected_error_mm: none,
                require_witness: true,
                always: false,
            },
            journal: JournalConfig {
                full: WhenFull::Refuse,
            },
            access: AccessConfig {
                locked_reading: LockedReading::Nobody,
                session_idle_s: Some(0),
                button_off: true,
            },
        }
    }
}
