//! The SPI line to the flash, read without gaps between the bytes.
//!
//! # Design
//!
//! The HAL asks for a byte and waits for it before it asks for the next: at 31.25 MHz the
//! line would rest for three quarters of the time. A start looks through 2 MB, so what is
//! read is asked for ahead, as far as the PL022's FIFOs reach.

use embassy_rp::pac;
use embassy_rp::peripherals::SPI0;
use embassy_rp::spi::{Blocking, Error, Spi};
use embedded_hal::spi::{ErrorType, SpiBus};

/// Depth of either FIFO (RP2040 datasheet, 4.4.2.3): so many bytes may be on their way.
const FIFO: usize = 8;

/// SPI 0, which reads ahead.
pub struct FlashLine(pub Spi<'static, SPI0, Blocking>);

impl ErrorType for FlashLine {
    type Error = Error;
}

impl SpiBus for FlashLine {
    fn read(&mut self, words: &mut [u8]) -> Result<(), Error> {
        // Whatever was written before has taken its answers out of the FIFO.
        let line = pac::SPI0;
        let ask = || line.dr().write(|data| data.set_data(0));
        let ahead = words.len().min(FIFO);
        for _ in 0..ahead {
            ask();
        }
        let mut to_ask = words.len() - ahead;
        for word in words {
            while !line.sr().read().rne() {}
            *word = line.dr().read().data() as u8;
            if to_ask > 0 {
                to_ask -= 1;
                ask();
            }
        }
        SpiBus::flush(self)
    }

    fn write(&mut self, words: &[u8]) -> Result<(), Error> {
        self.0.blocking_write(words)
    }

    fn transfer(&mut self, read: &mut [u8], write: &[u8]) -> Result<(), Error> {
        self.0.blocking_transfer(read, write)
    }

    fn transfer_in_place(&mut self, words: &mut [u8]) -> Result<(), Error> {
        self.0.blocking_transfer_in_place(words)
    }

    fn flush(&mut self) -> Result<(), Error> {
        self.0.flush()
    }
}
