//! libFuzzer on the target that `UMI_FUZZ_TARGET` names.
#![no_main]

use std::sync::LazyLock;

use umi_fuzz::targets::{TARGETS, Target};

static CHOSEN: LazyLock<Target> = LazyLock::new(|| {
    let name = std::env::var("UMI_FUZZ_TARGET").unwrap_or_default();
    let target = TARGETS.iter().find(|(target, _)| *target == name);
    target.expect("UMI_FUZZ_TARGET names a target").1
});

libfuzzer_sys::fuzz_target!(|data: &[u8]| CHOSEN(data));
