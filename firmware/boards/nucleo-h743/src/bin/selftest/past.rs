//! What happened before: a panic and a hard fault, both on purpose, and whether they were noted.

use umi_protocol::message::ResetReason;

use crate::reset::{self, Kept, nothing_kept};

/// Says that the rest of the number is ours.
const OURS: u64 = 0x5E1F_7E57 << 32;
const OURS_MASK: u64 = 0xFFFF_FFFF << 32;

/// The panic was noted.
const PANIC: u64 = 1 << 16;
/// The fault was.
const FAULT: u64 = 1 << 17;
const STARTS: u64 = 0xFFFF;
/// Starts that are planned: the first, behind the panic, behind the fault.
const PLANNED: u64 = 2;

/// In RAM that a reset leaves: the mark, what was noted, and how often the board has started behind the
/// first time.
#[unsafe(link_section = ".uninit.PAST")]
static PAST: Kept = nothing_kept();

/// What is known of the starts so far.
#[derive(Clone, Copy)]
pub struct Past {
    /// The panic was noted.
    pub panic_is_noted: bool,
    /// The hard fault was.
    pub fault_is_noted: bool,
    /// Starts that nobody has asked for.
    pub more_starts: u32,
}

/// Panics at the first start and faults at the second; returns at the third. The first one is by the
/// power or by the reset button: what else starts the board counts on.
#[allow(clippy::panic, reason = "on purpose")]
pub fn go_through(reason: ResetReason) -> Past {
    let kept = reset::kept(&PAST);
    let is_first = matches!(
        reason,
        ResetReason::PowerOn | ResetReason::BrownOut | ResetReason::Pin
    );
    let is_noted = reason == ResetReason::Panic;
    let (starts, mut noted) = match kept & OURS_MASK == OURS && !is_first {
        true => (
            (kept & STARTS).saturating_add(1).min(STARTS),
            kept & (PANIC | FAULT),
        ),
        false => (0, 0),
    };
    match starts {
        1 if is_noted => noted |= PANIC,
        PLANNED if is_noted => noted |= FAULT,
        _ => {}
    }
    reset::keep(&PAST, OURS | noted | starts);
    match starts {
        0 => panic!("on purpose"),
        1 => cortex_m::asm::udf(),
        _ => Past {
            panic_is_noted: noted & PANIC != 0,
            fault_is_noted: noted & FAULT != 0,
            more_starts: u32::try_from(starts.saturating_sub(PLANNED)).unwrap_or(u32::MAX),
        },
    }
}
