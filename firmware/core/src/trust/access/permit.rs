//! What the protocol's table and the board's mode say to a request.

use umi_protocol::access::{AccessMode, AccessRefusal, Role};
use umi_protocol::config::LockedReading;
use umi_protocol::message::Request;

/// Whether somebody of this role may ask for that.
///
/// An open board does for everybody what is asked. A claimed one demands the role of the table. A
/// locked one answers what needs nobody's key, lets an operator's key read where its owner has not
/// forbidden that ([`LockedReading`]), and is unlocked by an owner's; entries are not acknowledged
/// there, because that lets the board overwrite them.
///
/// What an owner's request demands besides ([`Request::KeyEnrol`] of the first key, [`Request::Wipe`])
/// is the board's to look at: its jumper.
///
/// # Errors
/// Why not.
pub fn permit(
    mode: AccessMode,
    has: Role,
    request: &Request,
    locked_reading: LockedReading,
) -> Result<(), AccessRefusal> {
    let needs = request.needs();
    let is_for_the_locked = match request {
        Request::LockSet { .. } => true,
        Request::JournalAck { .. } => false,
        _ => needs <= Role::Operator && locked_reading == LockedReading::Operators,
    };
    permit_role(mode, has, needs, is_for_the_locked)
}

/// As [`permit`], of a request that needs this role and that a locked board answers or not.
///
/// # Errors
/// As [`permit`].
pub fn permit_role(
    mode: AccessMode,
    has: Role,
    needs: Role,
    is_for_the_locked: bool,
) -> Result<(), AccessRefusal> {
    if mode == AccessMode::Open || needs == Role::None {
        return Ok(());
    }
    if mode == AccessMode::Locked && !is_for_the_locked {
        return Err(AccessRefusal::Locked);
    }
    match has {
        _ if has >= needs => Ok(()),
        Role::None => Err(AccessRefusal::KeyNeeded { needs }),
        has => Err(AccessRefusal::RoleTooLow { needs, has }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every request there is: all can be read from zeros behind their number.
    fn requests() -> std::vec::Vec<Request> {
        let read = |tag: u8| {
            let mut bytes = [0; 512];
            bytes[0] = tag;
            let read = postcard::take_from_bytes::<Request>(&bytes);
            read.ok().map(|(request, _)| request)
        };
        (0..0x80).filter_map(read).collect()
    }

    /// For every request, role and mode: what the table's column promises.
    #[test]
    fn the_table_is_what_a_board_asks_for() {
        let requests = requests();
        assert!(requests.len() >= 38, "{}", requests.len());
        let mut granted = 0;
        let readings = [LockedReading::Operators, LockedReading::Nobody];
        for (request, reading) in requests
            .iter()
            .flat_map(|request| readings.map(|reading| (request, reading)))
        {
            let needs = request.needs();
            for has in Role::ALL {
                let of = |mode| permit(mode, has, request, reading);
                assert_eq!(of(AccessMode::Open), Ok(()));
                let expected = if has >= needs {
                    Ok(())
                } else if has == Role::None {
                    Err(AccessRefusal::KeyNeeded { needs })
                } else {
                    Err(AccessRefusal::RoleTooLow { needs, has })
                };
                assert_eq!(of(AccessMode::Claimed), expected, "{request:?} by {has:?}");
                let reads = needs <= Role::Operator
                    && reading == LockedReading::Operators
                    && !matches!(request, Request::JournalAck { .. });
                let locked = match request {
                    _ if needs == Role::None => Ok(()),
                    Request::LockSet { .. } => expected,
                    _ if reads => expected,
                    _ => Err(AccessRefusal::Locked),
                };
                let found = of(AccessMode::Locked);
                assert_eq!(found, locked, "{request:?} by {has:?}, {reading:?}");
                granted += u32::from(expected.is_ok());
            }
        }
        assert!(granted > 160, "{granted}");
    }

    /// Nothing that changes what is in force is for less than an engineer, and nothing that
    /// changes who may do so for less than an owner.
    #[test]
    fn what_changes_is_not_for_everybody() {
        for request in requests() {
            let least = match request {
                Request::JobSet(_)
                | Request::ProgramBegin(_)
                | Request::ProgramPiece { .. }
                | Request::ProgramEnd { .. }
                | Request::ProgramDelete { .. }
                | Request::ProgramOffer { .. }
                | Request::ProgramPass(_)
                | Request::ProgramReceive
                | Request::TriggerOutSet(_)
                | Request::LaserSet { .. }
                | Request::LineListen(_)
                | Request::SensorSet(_)
                | Request::SensorCommand { .. }
                | Request::Teach { .. } => Role::Engineer,
                Request::ConfigSet(_)
                | Request::KeyEnrol(_)
                | Request::KeyRevoke { .. }
                | Request::LockSet { .. }
                | Request::UpdateBegin { .. }
                | Request::UpdatePiece { .. }
                | Request::UpdateEnd
                | Request::Wipe => Role::Owner,
                Request::ProgramRead { .. }
                | Request::JournalRead { .. }
                | Request::JobGet
                | Request::HostTime { .. }
                | Request::VerdictGet => Role::Operator,
                _ => Role::None,
            };
            assert!(request.needs() >= least, "{request:?}");
        }
    }
}
