//! How a host proves its key; from then on its requests are sealed, and so are the answers.

use ed25519_dalek::SigningKey;
use umi_core::trust::access::session::HostHandshake;
use umi_protocol::access::Role;

use super::client::Client;
use super::{LinkError, SessionAnswer};

impl Client {
    /// Proves a key to the board and returns what it is for. The board proves its own.
    ///
    /// # Errors
    /// [`LinkError::Refused`]: the board does not take it. [`LinkError::BoardNotProven`];
    /// [`LinkError`], as all calls.
    pub fn authenticate(&mut self, key: &SigningKey) -> Result<Role, LinkError> {
        let mut secret = [0; 32];
        getrandom::fill(&mut secret)
            .map_err(|error| LinkError::Closed(std::io::Error::other(error)))?;
        let handshake = HostHandshake::new(key, secret);
        let challenge = self.session_begin(handshake.ask())?;
        let challenge = challenge.ok_or(LinkError::NoSessions)?;
        let proven = handshake.prove(key, &challenge);
        let (signature, proof) = proven.ok_or(LinkError::BoardNotProven)?;
        let (role, signature) = match self.session_prove(signature)? {
            SessionAnswer::Open(role, signature) => (role, signature),
            SessionAnswer::NotOnThisBoard => return Err(LinkError::NoSessions),
        };
        self.session = Some(proof.open(signature).ok_or(LinkError::BoardNotProven)?);
        Ok(role)
    }

    /// The key that the board has proven, in a session.
    #[must_use]
    pub fn proven_board(&self) -> Option<&[u8; 32]> {
        self.session.as_ref().map(|session| session.board_key())
    }

    /// Whether requests are sealed.
    #[must_use]
    pub fn has_session(&self) -> bool {
        self.session.is_some()
    }
}
