//! Cargo's compiler for images: the same names of crates in every folder.
//!
//! Cargo gives each crate a name of its own (`-C metadata`). That of a package outside the boards'
//! workspace, as `umi-core`, has the whole path of the package in it, and so has that of each crate
//! that uses it: in another folder symbols have other names and code another order. Cargo calls
//! this program in the compiler's place ([`WRAPS`]); it puts a name without a path there and calls
//! the compiler. Crates of a registry are named by their version, and stay as they are.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, ExitCode};

/// Set where this program is called as the compiler.
pub const WRAPS: &str = "OPENUMI_WRAPS_RUSTC";

/// Calls the compiler that the first argument names, with the others.
pub fn call(mut arguments: impl Iterator<Item = OsString>) -> ExitCode {
    let Some(compiler) = arguments.next() else {
        return ExitCode::FAILURE;
    };
    let arguments = renamed(arguments.collect());
    let status = Command::new(compiler).args(arguments).status();
    let code = status.ok().and_then(|status| status.code());
    ExitCode::from(code.and_then(|code| u8::try_from(code).ok()).unwrap_or(1))
}

/// The compiler's arguments, with the name of one of our crates by the crate alone.
fn renamed(mut arguments: Vec<OsString>) -> Vec<OsString> {
    let after = |what: &str| {
        let at = arguments.iter().position(|argument| argument == what)?;
        arguments.get(at + 1)?.to_str().map(str::to_owned)
    };
    let is_of_a_registry = |argument: &OsString| {
        let source = Path::new(argument);
        let is_source = source.extension().is_some_and(|of| of == "rs");
        is_source
            && source
                .components()
                .any(|part| part.as_os_str() == "registry")
    };
    let Some(name) = after("--crate-name") else {
        return arguments;
    };
    if arguments.iter().any(is_of_a_registry) {
        return arguments;
    }
    for argument in &mut arguments {
        let is_name = argument
            .to_str()
            .is_some_and(|it| it.starts_with("metadata="));
        if is_name {
            *argument = OsString::from(format!("metadata=openumi-{name}"));
        }
    }
    arguments
}

#[cfg(test)]
mod tests {
    use super::renamed;

    fn words(text: &str) -> Vec<std::ffi::OsString> {
        text.split(' ').map(Into::into).collect()
    }

    /// One of ours is named by itself, another's crate keeps its name, and so does a call that
    /// compiles nothing.
    #[test]
    fn our_crates_are_named_without_a_path() {
        let ours = words("--crate-name umi_core core/src/lib.rs -C metadata=12ab -C opt-level=s");
        assert_eq!(
            renamed(ours),
            words(
                "--crate-name umi_core core/src/lib.rs -C metadata=openumi-umi_core -C opt-level=s"
            )
        );
        let other = "--crate-name nalgebra /a/registry/src/b/nalgebra/src/lib.rs -C metadata=12ab";
        for other in [other, "-vV"] {
            assert_eq!(renamed(words(other)), words(other));
        }
    }
}
