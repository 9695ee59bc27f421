//! Signed images as files, `BOARD.umif`: [`umi_core::trust::access::update::image`].

use std::path::Path;

use ed25519_dalek::Signer as _;
use sha2::{Digest as _, Sha512};
use umi_core::trust::access::update::image::ImageHeader;
use umi_protocol::job::Name;
use umi_protocol::update::{IMAGE_HEADER, ImageVersion};

use super::key_file::SigningKey;
use crate::problem::Problem;

/// An image that was read.
pub struct Image {
    /// What its header says.
    pub header: ImageHeader,
    /// The header as it stands there.
    pub header_bytes: [u8; IMAGE_HEADER],
    /// The signature, R and S.
    pub signature: [[u8; 32]; 2],
    /// The payload.
    pub payload: Vec<u8>,
}

/// `X.Y.Z`.
///
/// # Errors
/// What a version looks like.
pub fn parse_version(text: &str) -> Result<ImageVersion, String> {
    let numbers: Vec<u16> = text
        .split('.')
        .map(|part| part.parse().ok())
        .collect::<Option<_>>()
        .unwrap_or_default();
    numbers
        .try_into()
        .map_err(|_| "give a version as 1.2.3, each number up to 65535".to_owned())
}

/// A version as text.
#[must_use]
pub fn version_text([major, minor, patch]: ImageVersion) -> String {
    format!("{major}.{minor}.{patch}")
}

/// Signs a payload: the file's bytes.
///
/// # Errors
/// `image_too_long`; `usage`: the board's name has no character, more than 16 bytes, or control
/// characters.
pub fn sign(
    payload: &[u8],
    board: &str,
    version: ImageVersion,
    counter: u32,
    maker: &SigningKey,
) -> Result<(ImageHeader, Vec<u8>), Problem> {
    let board = Name::try_from(board)
        .ok()
        .filter(|board| !board.is_empty() && !board.contains(char::is_control))
        .ok_or_else(|| {
            let message = "the kind of board has 1 to 16 bytes, and no control characters: give it as umi info says it";
            Problem::trouble("usage", message)
        })?;
    let length = u32::try_from(payload.len())
        .map_err(|_| Problem::refused("image_too_long", "the payload has more than 4 GB"))?;
    let header = ImageHeader {
        board,
        version,
        counter,
        length,
        sha512: Sha512::digest(payload).into(),
        key_id: umi_core::trust::board_key::key_id(&maker.verifying_key().to_bytes()),
    };
    let signature = maker.sign(&header.signed());
    let bytes = header.encode([*signature.r_bytes(), *signature.s_bytes()]);
    Ok((header, [&bytes[..], payload].concat()))
}

/// Reads a file and holds its payload against its header. Whose signature it has, only a key says:
/// [`ImageHeader::is_signed`].
///
/// # Errors
/// It cannot be read; `image_damaged`.
pub fn read(path: &Path) -> Result<Image, Problem> {
    let bytes = std::fs::read(path).map_err(|error| Problem::file("read", path, &error))?;
    parse(&bytes).map_err(|what| {
        let message = format_args!("{}: {what}", path.display());
        Problem::refused("image_damaged", message)
    })
}

/// Reads a file's bytes, as [`read`].
///
/// # Errors
/// What is wrong with them.
pub fn parse(bytes: &[u8]) -> Result<Image, &'static str> {
    let (header_bytes, payload) = bytes
        .split_first_chunk::<IMAGE_HEADER>()
        .ok_or("it is too short for an image")?;
    let (header, signature) = ImageHeader::read(header_bytes)
        .map_err(|_| "it has no header of an image: give a file that `umi image sign` wrote")?;
    let is_whole = u32::try_from(payload.len()) == Ok(header.length)
        && <[u8; 64]>::from(Sha512::digest(payload)) == header.sha512;
    if !is_whole {
        return Err("its bytes are not those that its header names");
    }
    Ok(Image {
        header,
        header_bytes: *header_bytes,
        signature,
        payload: payload.to_vec(),
    })
}
