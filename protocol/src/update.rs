//! Signed images: which one a board runs, and why it takes none.

use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;
use thiserror::Error;

/// Bytes of an image's header: `umi_core::trust::access::update::image`.
pub const IMAGE_HEADER: usize = 192;

/// Major, minor, patch.
pub type ImageVersion = [u16; 3];

/// Where an image stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, IntoStaticStr)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum ImagePlace {
    /// It was there before any update.
    BuiltIn,
    /// The first slot.
    A,
    /// The second.
    B,
}

impl ImagePlace {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// What became of the latest update.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, IntoStaticStr)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum UpdateState {
    /// There was none, or it has not come to its end.
    None,
    /// It is whole and right, and runs for the first time.
    Trial,
    /// It has run, and is the one that starts.
    Confirmed,
    /// It did not confirm itself, or was changed where it stands: the one before runs again, or what was built in.
    Reverted,
}

impl UpdateState {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// The image that runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct ImageInfo {
    /// Its version.
    pub version: ImageVersion,
    /// Its security counter: none of a lower one is taken.
    pub counter: u32,
    /// Where it stands.
    pub place: ImagePlace,
    /// False: it runs on trial.
    pub confirmed: bool,
    /// SHA-512 of its bytes, in two halves; none: the board does not know them.
    pub sha512: Option<[[u8; 32]; 2]>,
    /// What became of the latest update.
    pub latest: UpdateState,
    /// The longest that it takes, without its header.
    pub most_bytes: u32,
}

/// Why an image is not taken.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum UpdateRefusal {
    /// Its signature is not by the maker's key that the board has.
    #[strum(serialize = "image_signature")]
    #[error("the image is not signed by the maker's key that this board has")]
    Signature,
    /// It is for another board.
    #[strum(serialize = "image_board")]
    #[error("the image is for another kind of board")]
    Board,
    /// It is older than what the board runs.
    #[strum(serialize = "image_rollback")]
    #[error(
        "the image is older than the one that runs, by its version or its security counter: a board does not go back"
    )]
    Rollback,
    /// Its bytes are not those that were signed.
    #[strum(serialize = "image_damaged")]
    #[error("the image is damaged: its bytes are not those that its header names")]
    Damaged,
    /// It finds no room.
    #[strum(serialize = "image_too_long")]
    #[error("the image is too long: the board has room for {most_bytes} bytes")]
    TooLong {
        /// For so many bytes there is.
        most_bytes: u32,
    },
    /// Something is measured or on its way.
    #[strum(serialize = "board_busy")]
    #[error(
        "a clamping is being measured, a program is on its way or an axis moves: update when the machine stands"
    )]
    Busy,
    /// No update has begun.
    #[strum(serialize = "not_begun")]
    #[error("no update has begun, or the board has started anew meanwhile: begin again")]
    NotBegun,
}

impl UpdateRefusal {
    /// The stable code.
    #[must_use]
    pub fn code(self) -> &'static str {
        self.into()
    }
}
