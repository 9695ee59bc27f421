//! What is to be taught, by whom, and why it is not.

use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;
use thiserror::Error;

/// Why nothing is to be taught.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum TeachRefusal {
    /// There is no job.
    #[error("the board has no job: `umi job set` gives it one")]
    NoJob,
    /// The job gives its positions.
    #[strum(serialize = "reference_given")]
    #[error("the job gives its positions (`reference = \"given\"`): there is nothing to teach")]
    Given,
    /// There is a reference, and nobody said that it is to be replaced.
    #[error("there is a reference already: ask again with --again to replace it")]
    AlreadyTaught,
    /// A setup is being measured: ask before it begins.
    #[error(
        "a clamping is being measured: ask before it begins, or give it up: `umi teach --again`"
    )]
    UnderWay,
    /// Nothing is taught that one more setup could add to.
    #[error("nothing is taught yet: ask without --more or --keep")]
    NotTaught,
    /// The job holds nothing against what was learned.
    #[error(
        "the job has no [guards.learned]: there are no limits that one more clamping could widen"
    )]
    NoLearned,
    /// The board's owner lets the button ask for nothing.
    #[error(
        "the board's owner lets its button teach nothing (access.button_off): ask with `umi teach` and an engineer's key"
    )]
    ButtonOff,
}

/// What the setup that comes next is to teach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum TeachWhat {
    /// The reference, where there is none.
    Reference,
    /// The reference, also in place of the one that there is.
    Again,
    /// How features may be, besides what was learned before. The reference stays.
    More,
    /// Nothing more: the setup that taught the reference is the one that was meant.
    Keep,
}

/// A teaching that somebody has asked for and that has not happened yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct TeachPending {
    /// Who asked.
    pub by: TeachBy,
    /// What is to be taught.
    pub what: TeachWhat,
    /// When it was asked for, since the board started.
    pub t_us: u64,
    /// By which setup.
    pub setup: TeachSetup,
}

/// Who asks to teach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum TeachBy {
    /// A host.
    Host,
    /// The board's button.
    Button,
    /// A checked line of the control. It asks for its own run alone.
    Line,
}

/// Which setup is to teach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum TeachSetup {
    /// The one that comes next.
    Next,
    /// The one under way.
    UnderWay {
        /// Its number.
        setup: u32,
    },
    /// One that was refused: it teaches only if what was refused is probed again now.
    Refused {
        /// Its number.
        setup: u32,
    },
}

impl TeachRefusal {
    /// The stable code.
    #[must_use]
    pub fn code(self) -> &'static str {
        self.into()
    }
}
