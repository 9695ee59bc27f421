//! The key that a boot ROM knows images by: it knows no other kind than ECDSA on secp256k1, so it is not the maker's.

use std::fs::{self, OpenOptions};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use k256::SecretKey;
use k256::ecdsa::SigningKey;
use k256::elliptic_curve::Generate as _;
use k256::pkcs8::LineEnding;

use crate::console;

/// Where it stands: beside the maker's.
fn file(maker: &Path) -> PathBuf {
    let mut name = maker.as_os_str().to_owned();
    name.push(".boot.pem");
    name.into()
}

/// Reads it, or makes one where there is none.
pub fn read_or_make(maker: &Path) -> Result<SigningKey> {
    let file = file(maker);
    let what = || format!("the boot ROM's key, {}", file.display());
    let text = match fs::read_to_string(&file) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let text = make(&file).with_context(what)?;
            console::progress(&format!(
                "made {}: keep it as safe as the maker's key, and as long as the boards live",
                file.display()
            ));
            text
        }
        Err(error) => return Err(error).with_context(what),
    };
    let key = SecretKey::from_sec1_pem(&text).with_context(|| {
        format!(
            "{}: no secret key in the form EC PRIVATE KEY",
            file.display()
        )
    })?;
    Ok(key.into())
}

/// Makes one that only its owner can read.
fn make(file: &Path) -> Result<String> {
    let text = SecretKey::try_generate()?.to_sec1_pem(LineEnding::LF)?;
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options.open(file)?.write_all(text.as_bytes())?;
    Ok(text.to_string())
}
