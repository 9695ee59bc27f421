//! What is to blame where nothing pairs: the encoder, a jump of the sensor's clock, another unit.

pub(super) mod encoder;
pub(super) mod jump;
pub(super) mod units;
