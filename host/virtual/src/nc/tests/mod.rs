//! The interpreter as a whole, on axes that note what they are told.

mod bounds;
mod checking;
mod fanuc;
mod linuxcnc;
mod mock;
