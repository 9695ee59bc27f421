//! Outputs to the machine.

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_rp::gpio::Output;
use umi_app::board::{Lights, Outputs};

/// For the status light, which blinks as long as the board is alive.
static TROUBLE: AtomicBool = AtomicBool::new(false);

/// Whether the storage has refused something.
pub fn trouble() -> bool {
    TROUBLE.load(Ordering::Relaxed)
}

/// Verdict and activity: high is on.
pub struct Lamps {
    /// The latest verdict is OK.
    pub ok: Output<'static>,
    /// The latest verdict is NG.
    pub ng: Output<'static>,
    /// A setup is under way.
    pub busy: Output<'static>,
}

impl Outputs for Lamps {
    fn show(&mut self, lights: Lights) {
        // First what goes out: never two at once.
        for on in [false, true] {
            let lamps = [
                (&mut self.ok, lights.ok),
                (&mut self.ng, lights.ng),
                (&mut self.busy, lights.busy),
            ];
            for (lamp, lit) in lamps {
                if lit == on {
                    lamp.set_level(lit.into());
                }
            }
        }
        TROUBLE.store(lights.trouble, Ordering::Relaxed);
    }
}
