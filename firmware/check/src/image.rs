//! The entry point: the whole application on a board without hardware.

use core::future::Future;
use core::hint::black_box;
use core::panic::PanicInfo;
use core::pin::pin;
use core::sync::atomic::AtomicU8;
use core::task::{Context, Waker};

use umi_app::measure::{Boot, name};
use umi_app::{App, Drivers};
use umi_core::units::Micros;
use umi_protocol::message::{Identity, ResetReason};

use crate::board::{Cnc, Dog, Lamps, Latches, Link, Memory, Station, Time};

/// The application's state.
static APP: App<Memory> = App::new();

/// The application's tasks, as one future.
async fn application() {
    let identity = Identity {
        board: name("check"),
        serial: name("none"),
        firmware: name(env!("CARGO_PKG_VERSION")),
    };
    let boot = Boot {
        identity,
        reset: ResetReason::Unknown,
    };
    // A board would log what could not be opened.
    let _ = black_box(APP.start(boot, Memory, Memory, Micros(0)));
    let drivers = Drivers {
        cnc_rx: Cnc,
        cnc_tx: Cnc,
        link_rx: Link,
        link_tx: Link,
        latches: Latches,
        station: Station,
        outputs: Lamps,
        watchdog: Dog,
    };
    APP.run(drivers, &Time).await;
}

/// The memory that a board sets aside for it. Here it is only reserved, to be measured:
/// atomic, so that it counts as variable.
#[used]
static RESERVED: [AtomicU8; size_of_output(application)] =
    [const { AtomicU8::new(0) }; size_of_output(application)];

const fn size_of_output<T>(_: fn() -> T) -> usize {
    size_of::<T>()
}

/// Where the image begins.
// SAFETY: no other symbol of this name is linked.
#[unsafe(no_mangle)]
extern "C" fn _start() -> ! {
    let mut future = pin!(application());
    let mut context = Context::from_waker(Waker::noop());
    loop {
        let _ = black_box(future.as_mut().poll(&mut context));
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    // A board reports where it happened: without this, the places would be optimised out.
    black_box(info.location());
    loop {}
}

struct Uninterrupted;

critical_section::set_impl!(Uninterrupted);

// SAFETY: the image enables no interrupt and has one core: nothing ever comes between.
unsafe impl critical_section::Impl for Uninterrupted {
    unsafe fn acquire() {}

    unsafe fn release((): ()) {}
}
