//! What each image of this board begins with: clocks and priorities.

use embassy_stm32::interrupt::{InterruptExt as _, Priority};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Config, interrupt, rcc};

use crate::resources;

/// The clocks of [`resources`].
pub fn configuration() -> Config {
    use rcc::{
        AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllDiv, PllMul, PllPreDiv, PllSource,
    };
    const {
        assert!(resources::PLL[0] == 1 && resources::PLL[1] == 100 && resources::PLL[2] == 2);
        assert!(resources::BUS_DIVIDERS[0] == 2 && resources::BUS_DIVIDERS[1] == 2);
    }
    let mut config = Config::default();
    config.rcc.hse = Some(Hse {
        freq: Hertz(resources::HSE_HZ),
        mode: HseMode::Bypass,
    });
    config.rcc.pll1 = Some(Pll {
        source: PllSource::HSE,
        prediv: PllPreDiv::DIV1,
        mul: PllMul::MUL100,
        fracn: None,
        divp: Some(PllDiv::DIV2),
        divq: None,
        divr: None,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV2;
    config.rcc.apb1_pre = APBPrescaler::DIV2;
    config.rcc.apb2_pre = APBPrescaler::DIV2;
    config.rcc.apb3_pre = APBPrescaler::DIV2;
    config.rcc.apb4_pre = APBPrescaler::DIV2;
    config.rcc.voltage_scale = rcc::VoltageScale::Scale1;
    // USB has an oscillator of its own, which the host's frames trim.
    config.rcc.hsi48 = Some(rcc::Hsi48Config {
        sync_from_usb: true,
    });
    config.rcc.mux.usbsel = rcc::mux::Usbsel::HSI48;
    config
}

/// Latching above all, then the serial line, then the link.
pub fn set_priorities() {
    for (interrupt, priority) in [
        (interrupt::TIM5, Priority::P1),
        (interrupt::TIM7, Priority::P1),
        (interrupt::USART2, Priority::P2),
        (interrupt::USART6, Priority::P2),
        (interrupt::TIM8_BRK_TIM12, Priority::P3),
        (interrupt::UART4, Priority::P4),
        (interrupt::UART7, Priority::P5),
        (interrupt::OTG_FS, Priority::P6),
        (interrupt::UART5, Priority::P7),
    ] {
        interrupt.set_priority(priority);
    }
    for interrupt in [
        interrupt::TIM5,
        interrupt::TIM7,
        interrupt::USART2,
        interrupt::USART6,
    ] {
        // SAFETY: their functions are written for the state that they find.
        unsafe { interrupt.enable() };
    }
}
