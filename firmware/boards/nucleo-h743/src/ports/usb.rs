//! USB beside the HAL's driver: its interrupt, served by the task of the link, and its plug.
//!
//! # Design
//!
//! The HAL's handler can panic, by what the controller reports of a packet. An interrupt must not, so it
//! only holds itself off and wakes the task, which calls the handler and lets the next one come. The
//! controller keeps what it has received meanwhile, and tells the host to wait where that is full.
//! Whatever the handler wakes runs in the same task: nothing is later by it.

use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, Ordering};
use core::task::Poll;

use embassy_stm32::interrupt::typelevel::{self, Binding, Handler as _};
use embassy_stm32::interrupt::{self, InterruptExt as _};
use embassy_stm32::pac;
use embassy_stm32::peripherals::USB_OTG_FS;
use embassy_stm32::usb::InterruptHandler;
use embassy_sync::waitqueue::AtomicWaker;
use umi_drivers::usb_plug::Plug;

static HAS_COME: AtomicBool = AtomicBool::new(false);
static SERVER: AtomicWaker = AtomicWaker::new();

/// Says to the driver that its handler is called at each interrupt.
#[derive(Clone, Copy)]
pub struct Served;

// SAFETY: `serve` calls it once for each interrupt, and no further one comes before.
unsafe impl Binding<typelevel::OTG_FS, InterruptHandler<USB_OTG_FS>> for Served {}

#[embassy_stm32::interrupt]
fn OTG_FS() {
    interrupt::OTG_FS.disable();
    HAS_COME.store(true, Ordering::Release);
    SERVER.wake();
}

/// Serves the interrupt, for ever: to be run beside the device, in the same task.
pub async fn serve() -> ! {
    loop {
        poll_fn(|context| {
            SERVER.register(context.waker());
            match HAS_COME.swap(false, Ordering::Acquire) {
                true => Poll::Ready(()),
                false => Poll::Pending,
            }
        })
        .await;
        // SAFETY: the interrupt has come and is held off, so nothing else is in the handler; who
        // shares its state shares this task.
        unsafe { InterruptHandler::<USB_OTG_FS>::on_interrupt() };
        // It was noted again while its reason was still there.
        interrupt::OTG_FS.unpend();
        // SAFETY: its function is written for the state that it finds.
        unsafe { interrupt::OTG_FS.enable() };
    }
}

/// The plug. To be used behind the device's first step, which starts the controller's clock.
pub struct UsbPlug;

impl Plug for UsbPlug {
    fn has_power(&mut self) -> bool {
        // The controller looks at PA9 itself, and pulls no line without.
        true
    }

    fn frame(&mut self) -> u16 {
        pac::USB_OTG_FS.dsts().read().fnsof()
    }

    fn show(&mut self, shown: bool) {
        pac::USB_OTG_FS.dctl().modify(|w| w.set_sdis(!shown));
    }
}
