//! Which board is meant: `--port`, `UMI_PORT`, or the only one that is plugged in.

use ed25519_dalek::SigningKey;
use serialport::{SerialPortInfo, SerialPortType};

use umi_protocol::access::AccessMode;

use crate::board::link::{self, Client, Transport};
use crate::problem::Problem;

/// What a board's USB descriptors say.
const MAKER: &str = "openumi";

/// Connects to the board at an address, or to the only openumi board on USB.
///
/// # Errors
/// No board or several on USB where none is named; [`crate::board::link::LinkError`].
pub fn connect(address: Option<&str>) -> Result<Client, Problem> {
    Ok(Client::open(&meant(address)?)?)
}

/// Opens the port of the board at an address, or of the only openumi board on USB, and says
/// nothing.
///
/// # Errors
/// As [`connect`].
pub fn open(address: Option<&str>) -> Result<Box<dyn Transport>, Problem> {
    Ok(link::open(&meant(address)?)?)
}

fn meant(address: Option<&str>) -> Result<String, Problem> {
    match address {
        Some(address) => Ok(address.to_owned()),
        None => only(&serialport::available_ports().unwrap_or_default()),
    }
}

/// Connects as [`connect`], and proves this key to a board that has an owner.
///
/// # Errors
/// As [`connect`]; the key is not taken.
pub fn connect_with(address: Option<&str>, key: Option<&SigningKey>) -> Result<Client, Problem> {
    let mut board = connect(address)?;
    if let Some(key) = key
        && board.access()?.mode != AccessMode::Open
    {
        board.authenticate(key)?;
    }
    Ok(board)
}

/// The only board among the ports.
fn only(ports: &[SerialPortInfo]) -> Result<String, Problem> {
    let boards: Vec<&SerialPortInfo> = ports.iter().filter(|port| is_board(port)).collect();
    match boards.as_slice() {
        [board] => Ok(board.port_name.clone()),
        [] => Err(Problem::trouble("no_board", no_board(ports))),
        several => Err(Problem::trouble(
            "several_boards",
            format_args!(
                "{} openumi boards are plugged in; name one with --port:{}",
                several.len(),
                list(several.iter().copied())
            ),
        )),
    }
}

fn no_board(ports: &[SerialPortInfo]) -> String {
    let others = if ports.is_empty() {
        String::new()
    } else {
        format!("\nother serial ports here:{}", list(ports.iter()))
    };
    format!(
        "no openumi board is plugged in; connect one, or name its address with --port or \
         UMI_PORT (a serial port as /dev/ttyACM0 or COM3, or tcp://host:port){others}"
    )
}

fn is_board(port: &SerialPortInfo) -> bool {
    let SerialPortType::UsbPort(usb) = &port.port_type else {
        return false;
    };
    [&usb.manufacturer, &usb.product]
        .into_iter()
        .flatten()
        .any(|text| text.to_lowercase().contains(MAKER))
}

fn list<'a>(ports: impl Iterator<Item = &'a SerialPortInfo>) -> String {
    ports
        .map(|port| format!("\n  {}{}", port.port_name, described(port)))
        .collect()
}

fn described(port: &SerialPortInfo) -> String {
    let SerialPortType::UsbPort(usb) = &port.port_type else {
        return String::new();
    };
    let product = usb.product.as_deref().unwrap_or("USB device");
    match &usb.serial_number {
        Some(serial) => format!("  {product}, serial number {serial}"),
        None => format!("  {product}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::ProblemKind;
    use serialport::UsbPortInfo;

    fn usb(name: &str, manufacturer: &str, serial: &str) -> SerialPortInfo {
        SerialPortInfo {
            port_name: name.into(),
            port_type: SerialPortType::UsbPort(UsbPortInfo {
                vid: 0x1209,
                pid: 1,
                serial_number: Some(serial.into()),
                manufacturer: Some(manufacturer.into()),
                product: Some("device".into()),
            }),
        }
    }

    /// Of many ports, the only openumi board is used without asking.
    #[test]
    fn the_only_board_is_meant() {
        let ports = [
            usb("/dev/ttyACM0", "somebody", "1"),
            usb("/dev/ttyACM1", "openumi", "2"),
        ];
        assert_eq!(only(&ports).unwrap(), "/dev/ttyACM1");
    }

    /// Two boards are never guessed between: both are listed with their numbers.
    #[test]
    fn several_boards_are_listed() {
        let ports = [
            usb("/dev/ttyACM0", "openumi", "A7"),
            usb("/dev/ttyACM1", "OpenUMI", "B8"),
        ];
        let failure = only(&ports).unwrap_err();
        let message = &failure.message;
        for text in ["/dev/ttyACM0", "A7", "/dev/ttyACM1", "B8", "--port"] {
            assert!(message.contains(text), "{message}");
        }
        assert_eq!(failure.kind, ProblemKind::Trouble);
    }

    /// Without a board, the message says how to name one and what else is there.
    #[test]
    fn no_board_says_what_to_do() {
        let failure = only(&[usb("/dev/ttyUSB9", "somebody", "1")]).unwrap_err();
        let message = &failure.message;
        for text in ["--port", "UMI_PORT", "tcp://", "/dev/ttyUSB9"] {
            assert!(message.contains(text), "{message}");
        }
    }
}
