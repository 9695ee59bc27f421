//! The licences of everything that is linked into something of ours.
//!
//! openumi is `MIT OR Apache-2.0`; what it builds on must let its users keep to that.

use anyhow::{Context as _, Result, ensure};

use crate::emulators;
use crate::firmware;
use crate::fuzz;
use crate::house::{House, metadata};

/// Licences that ask for no more than a notice.
const ALLOWED: [&str; 8] = [
    "MIT",
    "MIT-0",
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "Zlib",
    "Unicode-3.0",
];

/// Packages with a licence of their own, each with the reason why that is acceptable.
const EXCEPTIONS: [(&str, &str); 2] = [
    // Copyleft by file: its own files stay MPL-2.0, and only the host tool links them.
    ("serialport", "MPL-2.0"),
    // As lax as BSD-3-Clause, and only the fuzz targets, which nobody ships, link it.
    ("libfuzzer-sys", "NCSA"),
];

/// Holds that every package of the lock files has a licence that is allowed.
pub fn check(house: &House) -> Result<()> {
    let mut refused = Vec::new();
    let manifests = [
        house.root.join("Cargo.toml"),
        firmware::manifest(house),
        fuzz::manifest(house),
    ];
    for manifest in manifests {
        let mut command = house.cargo();
        refused.extend(of_cargo(&metadata(
            command.args(["metadata", "--manifest-path"]).arg(manifest),
        )?)?);
    }
    let lock = emulators::folder(house).join("package-lock.json");
    let lock = std::fs::read_to_string(&lock)
        .with_context(|| format!("cannot read {}", lock.display()))?;
    refused.extend(of_npm(&serde_json::from_str(&lock)?)?);
    ensure!(
        refused.is_empty(),
        "packages whose licence is not among those allowed in host/xtask/src/licences.rs:\n  {}",
        refused.join("\n  ")
    );
    Ok(())
}

/// The packages of `cargo metadata` whose licences are not allowed.
fn of_cargo(metadata: &serde_json::Value) -> Result<Vec<String>> {
    let packages = metadata.get("packages").and_then(|list| list.as_array());
    let packages = packages.context("cargo metadata lists no packages")?;
    let refused = packages
        .iter()
        .filter_map(|package| {
            let text = |key| package.get(key).and_then(|value| value.as_str());
            let name = text("name").unwrap_or("(no name)");
            let licence = text("license").unwrap_or("");
            (!is_allowed(name, licence)).then(|| format!("{name}: `{licence}`"))
        })
        .collect();
    Ok(refused)
}

/// The packages of a `package-lock.json` whose licences are not allowed.
fn of_npm(lock: &serde_json::Value) -> Result<Vec<String>> {
    let packages = lock.get("packages").and_then(|list| list.as_object());
    let packages = packages.context("package-lock.json lists no packages")?;
    let refused = packages
        .iter()
        .filter_map(|(path, package)| {
            let licence = package["license"].as_str().unwrap_or("");
            let name = path
                .rsplit_once("node_modules/")
                .map_or("(ours)", |(_, name)| name);
            (!is_allowed(name, licence)).then(|| format!("{name} (npm): `{licence}`"))
        })
        .collect();
    Ok(refused)
}

/// Whether a package of this SPDX expression may be used. One that names none may not.
fn is_allowed(package: &str, licence: &str) -> bool {
    // Older packages write `MIT/Apache-2.0`, which is lax SPDX for OR.
    let Ok(expression) = spdx::Expression::parse_mode(licence, spdx::ParseMode::LAX) else {
        return false;
    };
    expression.evaluate(|requirement| {
        let licence = requirement.license.id().map_or("", |id| id.name);
        ALLOWED.contains(&licence) || EXCEPTIONS.contains(&(package, licence))
    })
}

#[cfg(test)]
mod tests {
    use super::{is_allowed, of_npm};

    /// One allowed way out of several is enough; all parts of an `AND` must be allowed.
    #[test]
    fn expressions() {
        assert!(is_allowed("x", "MIT OR Apache-2.0"));
        assert!(is_allowed("x", "MIT/Apache-2.0"));
        assert!(is_allowed("x", "Apache-2.0 / MIT"));
        assert!(is_allowed("x", "GPL-3.0-only OR MIT"));
        assert!(is_allowed("x", "(MIT OR Apache-2.0) AND Unicode-3.0"));
        assert!(is_allowed("x", "Apache-2.0 WITH LLVM-exception OR MIT"));
        assert!(!is_allowed("x", "MIT AND GPL-3.0-only"));
        assert!(!is_allowed("x", "GPL-3.0-only"));
        assert!(!is_allowed("x", ""));
    }

    /// A package of npm without a licence, or with one that is not allowed, is named.
    #[test]
    fn npm() {
        let lock = serde_json::json!({"packages": {
            "": {"license": "MIT OR Apache-2.0"},
            "node_modules/rp2040js": {"license": "MIT"},
            "node_modules/a/node_modules/@b/c": {"license": "GPL-3.0-only"},
            "node_modules/d": {},
        }});
        assert_eq!(
            of_npm(&lock).unwrap(),
            ["@b/c (npm): `GPL-3.0-only`", "d (npm): ``"]
        );
        assert!(of_npm(&serde_json::json!({})).is_err());
    }

    /// An exception is one package's, not a licence's.
    #[test]
    fn exceptions() {
        assert!(is_allowed("serialport", "MPL-2.0"));
        assert!(!is_allowed("other", "MPL-2.0"));
        assert!(!is_allowed("serialport", "GPL-3.0-only"));
        assert!(is_allowed("libfuzzer-sys", "(MIT OR Apache-2.0) AND NCSA"));
    }
}
