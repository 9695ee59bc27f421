//! The entry point, and everything that a board calls.

use core::hint::black_box;
use core::panic::PanicInfo;

use umi_app as _;
use umi_core::units::Mm;
use umi_protocol as _;

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    // A board reports where it happened: without this, the places would be optimised out.
    black_box(info.location());
    loop {}
}

/// Where the image begins.
// SAFETY: no other symbol of this name is linked.
#[unsafe(no_mangle)]
extern "C" fn _start() -> ! {
    loop {
        black_box(black_box(Mm(2.0)));
        black_box(black_box(Mm(1.0)));
    }
}
