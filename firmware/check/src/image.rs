//! The entry point, and everything that a board calls.

use core::hint::black_box;
use core::panic::PanicInfo;

use umi_app as _;
use umi_core::fit::sphere;
use umi_core::registration::register;
use umi_core::units::Point;
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
    let points = [Point::from_mm(0.0, 0.0, 0.0); 64];
    loop {
        // What is in a black box is unknown to the compiler, and what goes into one is used.
        let points = black_box(&points[..]);
        let _ = black_box(sphere::fit(points));
        let _ = black_box(register(points, black_box(points)));
    }
}
