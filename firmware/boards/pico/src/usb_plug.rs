//! The USB plug: the module's own pin at its 5 V, and the pull-up that shows the board to a host.

use embassy_rp::pac;
use umi_drivers::usb_plug::Plug;

use crate::pins::{self, VBUS};

/// The plug.
pub struct UsbPlug;

impl Plug for UsbPlug {
    fn has_power(&mut self) -> bool {
        pins::is_among(VBUS, pac::SIO.gpio_in(0).read())
    }

    fn frame(&mut self) -> u16 {
        pac::USB.sof_rd().read().count()
    }

    fn show(&mut self, shown: bool) {
        pac::USB.sie_ctrl().modify(|w| w.set_pullup_en(shown));
    }
}
