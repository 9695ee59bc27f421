//! Keys as files: Ed25519 as PKCS #8 and SPKI in PEM (RFC 8410), as other programs read them, too.

use std::fs::OpenOptions;
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};

pub use ed25519_dalek::SigningKey;
use ed25519_dalek::VerifyingKey;
use ed25519_dalek::pkcs8::spki::der::pem::LineEnding;
use ed25519_dalek::pkcs8::{
    DecodePrivateKey as _, DecodePublicKey as _, EncodePrivateKey as _, EncodePublicKey as _,
    KeypairBytes,
};

use crate::journal::nonce;
use crate::problem::Problem;

/// Longer than any key's text, in bytes.
const LONGEST: u64 = 16_384;

/// A public key as text.
///
/// # Errors
/// `not_a_key`: it is none.
pub fn public_text(key: &[u8; 32]) -> Result<String, Problem> {
    let key = VerifyingKey::from_bytes(key).map_err(|_| not_a_key("this"))?;
    key.to_public_key_pem(LineEnding::LF)
        .map_err(|_| not_a_key("this"))
}

/// Reads a public key.
///
/// # Errors
/// The file cannot be read; `not_a_key`.
pub fn read_public(path: &Path) -> Result<[u8; 32], Problem> {
    let text = read(path)?;
    parse_public(&text).ok_or_else(|| not_a_key(&path.display().to_string()))
}

/// Reads a public key's text; none: it is none.
#[must_use]
pub fn parse_public(text: &str) -> Option<[u8; 32]> {
    let key = VerifyingKey::from_public_key_pem(text).ok()?;
    Some(key.to_bytes())
}

/// Reads a secret key; `passphrase` is asked for the one of a file that is encrypted.
///
/// # Errors
/// The file cannot be read; `not_a_key`; `wrong_passphrase`; `key_seen_by_others`: it has no
/// passphrase, and not its owner alone can read it; what `passphrase` says.
pub fn read_secret(
    path: &Path,
    passphrase: impl FnOnce() -> Result<String, Problem>,
) -> Result<SigningKey, Problem> {
    let text = read(path)?;
    let file = path.display();
    if text.contains("BEGIN ENCRYPTED PRIVATE KEY") {
        return SigningKey::from_pkcs8_encrypted_pem(&text, passphrase()?).map_err(|_| {
            let message = format_args!("{file} does not open with this passphrase");
            Problem::trouble("wrong_passphrase", message)
        });
    }
    let key = SigningKey::from_pkcs8_pem(&text).map_err(|_| {
        let message = format_args!(
            "{file} is no Ed25519 secret key: give the file that `umi key new` wrote, not its .pub"
        );
        Problem::trouble("not_a_key", message)
    })?;
    if is_seen_by_others(path)? {
        let message = format_args!(
            "{file} is a secret key without a passphrase, and others on this computer can read it: who had it is the board's user, too. Make a new one (umi key new), or, if nobody else has been here, `chmod 600 {file}`"
        );
        return Err(Problem::trouble("key_seen_by_others", message));
    }
    Ok(key)
}

/// The text of a key, which is short: what is longer, or has no end, is none.
fn read(path: &Path) -> Result<String, Problem> {
    let mut text = Vec::new();
    std::fs::File::open(path)
        .and_then(|file| file.take(LONGEST).read_to_end(&mut text))
        .map_err(|error| Problem::file("read", path, &error))?;
    Ok(String::from_utf8_lossy(&text).into_owned())
}

/// Whether a file's permissions let its group or everybody read it.
fn is_seen_by_others(path: &Path) -> Result<bool, Problem> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        let about = path
            .metadata()
            .map_err(|error| Problem::file("read", path, &error))?;
        Ok(about.is_file() && about.permissions().mode() & 0o077 != 0)
    }
    #[cfg(not(unix))]
    {
        let _ = path;
        Ok(false)
    }
}

fn not_a_key(what: &str) -> Problem {
    let message = format_args!(
        "{what} is no Ed25519 public key: give a file that `umi access board-key` or `umi key new` wrote"
    );
    Problem::trouble("not_a_key", message)
}

/// A new key pair.
pub struct NewKey {
    /// The public key.
    pub public: [u8; 32],
    /// Where it is.
    pub public_file: PathBuf,
}

/// Makes a new key pair in two files, FILE and FILE.pub, neither of which may be there. Only their
/// owner can read the secret one; with a passphrase it is encrypted (PBES2: scrypt, AES-256).
///
/// # Errors
/// The files are there or cannot be written; the system has no entropy.
pub fn new(path: &Path, passphrase: Option<&str>) -> Result<NewKey, Problem> {
    let signing = SigningKey::from_bytes(&nonce()?);
    let public = signing.verifying_key().to_bytes();
    // Without the public key in it, as openssl writes it: version 1. Others refuse version 2.
    let version_1 = KeypairBytes {
        secret_key: signing.to_bytes(),
        public_key: None,
    };
    let text = match passphrase {
        None => version_1.to_pkcs8_pem(LineEnding::LF),
        Some(passphrase) => version_1.to_pkcs8_encrypted_pem(passphrase, LineEnding::LF),
    };
    let text = text.map_err(|error| Problem::trouble("key", error))?;
    let mut name = path.as_os_str().to_owned();
    name.push(".pub");
    let public_file = PathBuf::from(name);
    if public_file.symlink_metadata().is_ok() {
        let there = std::io::Error::from(std::io::ErrorKind::AlreadyExists);
        return Err(Problem::file("write", &public_file, &there));
    }
    create(path, true, text.as_bytes())?;
    create(&public_file, false, public_text(&public)?.as_bytes())?;
    Ok(NewKey {
        public,
        public_file,
    })
}

/// Writes a file that is not there yet; follows no link.
fn create(path: &Path, is_secret: bool, bytes: &[u8]) -> Result<(), Problem> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    if is_secret {
        use std::os::unix::fs::OpenOptionsExt as _;
        options.mode(0o600);
    }
    #[cfg(not(unix))]
    let _ = is_secret;
    let written = options.open(path).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    written.map_err(|error| Problem::file("write", path, &error))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("umi-key-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        path
    }

    /// The secret key is its owner's alone and opens with its passphrase only; nothing that is
    /// there is replaced.
    #[test]
    fn a_new_key_is_two_files() {
        let folder = folder("new");
        let (plain, locked) = (folder.join("plain"), folder.join("locked"));
        let made = new(&plain, None).unwrap();
        assert_eq!(read_public(&made.public_file).unwrap(), made.public);
        let text = std::fs::read_to_string(&plain).unwrap();
        let signing = SigningKey::from_pkcs8_pem(&text).unwrap();
        assert_eq!(signing.verifying_key().to_bytes(), made.public);
        // Version 1, as in RFC 8410, section 10.3, first example: what others read.
        let is_version_1 = |text: &str| text.contains("\nMC4CAQAwBQYDK2VwBCIEI");
        assert!(is_version_1(&text), "{text}");
        let before = signing.to_pkcs8_pem(LineEnding::LF).unwrap();
        assert!(!is_version_1(&before));
        let read_before = SigningKey::from_pkcs8_pem(&before).unwrap();
        assert_eq!(read_before, signing, "version 2 is read as ever");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            let mode = std::fs::metadata(&plain).unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o600);
            let ask = || -> Result<String, Problem> { panic!("it has no passphrase") };
            assert_eq!(read_secret(&plain, ask).unwrap(), signing);
            let open = std::fs::Permissions::from_mode(0o640);
            std::fs::set_permissions(&plain, open).unwrap();
            let refused = read_secret(&plain, ask).unwrap_err();
            assert_eq!(refused.code, "key_seen_by_others");
            // It has no end.
            let refused = read_secret(Path::new("/dev/zero"), ask).unwrap_err();
            assert_eq!(refused.code, "not_a_key");
        }
        assert_eq!(new(&plain, None).err().unwrap().code, "file");
        std::fs::remove_file(&plain).unwrap();
        assert_eq!(new(&plain, None).err().unwrap().code, "file");
        assert!(!plain.exists());

        let made = new(&locked, Some("open sesame")).unwrap();
        let text = std::fs::read_to_string(&locked).unwrap();
        assert!(text.starts_with("-----BEGIN ENCRYPTED PRIVATE KEY-----"));
        assert!(SigningKey::from_pkcs8_encrypted_pem(&text, "open").is_err());
        let signing = SigningKey::from_pkcs8_encrypted_pem(&text, "open sesame").unwrap();
        assert_eq!(signing.verifying_key().to_bytes(), made.public);
        std::fs::remove_dir_all(folder).unwrap();
    }

    /// The form of RFC 8410, section 10.1 and its key.
    #[test]
    fn public_keys_are_as_in_the_standard() {
        let text = "-----BEGIN PUBLIC KEY-----\nMCowBQYDK2VwAyEAGb9ECWmEzf6FQbrBZ9w7lshQhqowtrbLDFw4rXAxZuE=\n-----END PUBLIC KEY-----\n";
        let folder = folder("standard");
        let path = folder.join("key.pub");
        std::fs::write(&path, text).unwrap();
        let key = read_public(&path).unwrap();
        assert_eq!(key[..4], [0x19, 0xBF, 0x44, 0x09]);
        assert_eq!(public_text(&key).unwrap(), text);
        std::fs::write(&path, "no key").unwrap();
        assert_eq!(read_public(&path).unwrap_err().code, "not_a_key");
        std::fs::remove_dir_all(folder).unwrap();
    }
}
