//! BlockSender and receiver with a real control, with each other, and with anything.

mod captures;
mod line;
mod receiver;
mod sender;

use std::vec;
use std::vec::Vec;

use super::*;

/// A block as it stands on the line.
fn frame(number: u8, data: &[u8]) -> Vec<u8> {
    let mut frame = vec![SOH, number, !number];
    frame.extend_from_slice(data);
    frame.resize(FRAME - 1, SUB);
    let check = sum(&frame[3..]);
    frame.push(check);
    frame
}
