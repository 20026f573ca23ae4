//! The connection to Haply's Inverse service, a program that passes on the state of Haply's haptic devices and takes
//! forces for them: which addresses of the service are allowed, and a WebSocket on which no call waits beyond a
//! deadline and no message is larger than a limit.

use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{IpAddr, Shutdown, SocketAddr, TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use palpate::internal::haptics::Fault;
use serde::Deserialize;
use tungstenite::error::ProtocolError;
use tungstenite::http::Uri;
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Error, Message, Utf8Bytes, WebSocket};

/// Greatest size of a message, bytes; the service's list of several devices has about 5000 bytes.
const LARGEST: usize = 64 * 1024;
/// Greatest size of the answer to the HTTP request for the service's version, bytes.
const LARGEST_VERSION: u64 = 16 * 1024;
/// Longest wait for a connection, its handshake included.
const CONNECT_WAIT: Duration = Duration::from_millis(500);
/// Longest wait for the service's version over HTTP.
const VERSION_WAIT: Duration = Duration::from_millis(300);
/// Longest wait until the service accepts a message.
const SEND_WAIT: Duration = Duration::from_millis(20);
/// Number of messages without text in a row after which receiving fails with [`Fault::Garbled`].
const MOST_OTHERS: usize = 64;
/// The service's default port, used where a URL names none.
const PORT: u16 = 10001;

/// Address of the service.
#[derive(Debug, Clone)]
pub struct Address {
    url: String,
    host: String,
    port: u16,
    trust_remote: bool,
}

impl Address {
    /// Reads a URL such as `ws://localhost:10001`.
    ///
    /// # Errors
    /// [`Fault::Lost`] if the text is no such URL, or if its host is neither `localhost` nor a loopback address and
    /// `trust_remote` is not set.
    pub fn new(url: &str, trust_remote: bool) -> Result<Address, Fault> {
        let refuse = |why: &str| Err(Fault::Lost(format!("{url:?} {why}")));
        let Some(uri) = url.parse::<Uri>().ok().filter(|uri| uri.host().is_some()) else {
            return refuse("is not an address: use one such as ws://localhost:10001");
        };
        if uri.scheme_str() != Some("ws") {
            return refuse("is not the address of a WebSocket without TLS: use one such as ws://localhost:10001");
        }
        let name = uri.host().unwrap_or_default();
        // `Uri` does not distinguish a missing port from one that is too large.
        let port = match uri.authority().and_then(|all| all.as_str().strip_prefix(name)) {
            Some("") => Some(PORT),
            rest => rest.and_then(|rest| rest.strip_prefix(':')).and_then(|port| port.parse().ok()),
        };
        let Some(port) = port else {
            return refuse("has an invalid port: use an address such as ws://localhost:10001");
        };
        let host = name.trim_matches(['[', ']']).to_string();
        let loopback = host.parse::<IpAddr>().map_or(host.eq_ignore_ascii_case("localhost"), |ip| ip.is_loopback());
        if !loopback && !trust_remote {
            return refuse("is not on this machine: use localhost, or set trust_remote if that service is trusted");
        }
        Ok(Address { url: url.into(), host, port, trust_remote })
    }

    /// The URL as it was given.
    pub fn url(&self) -> &str {
        &self.url
    }

    fn resolve(&self) -> Result<Vec<SocketAddr>, Fault> {
        let found = (self.host.as_str(), self.port).to_socket_addrs().map_err(|e| lost(&e))?;
        let allowed: Vec<_> = found.filter(|found| self.trust_remote || found.ip().is_loopback()).collect();
        let none = || Fault::Lost(format!("{} does not resolve to a loopback address", self.host));
        if allowed.is_empty() { Err(none()) } else { Ok(allowed) }
    }

    /// Connects to the host at the first of its socket addresses that answers.
    ///
    /// # Errors
    /// The failure of the last address that was tried.
    pub fn connect(&self) -> Result<Link, Fault> {
        let mut failure = None;
        for peer in self.resolve()? {
            match Link::new(peer, &self.url) {
                Ok(link) => return Ok(link),
                Err(fault) => failure = Some(fault),
            }
        }
        Err(failure.unwrap_or_else(|| Fault::Lost("the host name has no address".into())))
    }
}

fn lost(why: &dyn std::error::Error) -> Fault {
    Fault::Lost(why.to_string())
}

/// A WebSocket to the service.
pub struct Link {
    socket: WebSocket<Timed>,
    peer: SocketAddr,
}

impl Link {
    fn new(peer: SocketAddr, url: &str) -> Result<Link, Fault> {
        let stream = Timed::connect(peer, CONNECT_WAIT).map_err(|e| lost(&e))?;
        let config = WebSocketConfig::default()
            .max_message_size(Some(LARGEST))
            .max_frame_size(Some(LARGEST))
            .read_buffer_size(LARGEST)
            .write_buffer_size(0)
            .max_write_buffer_size(LARGEST);
        match tungstenite::client::client_with_config(url, stream, Some(config)) {
            Ok((socket, _)) => Ok(Link { socket, peer }),
            Err(e) => Err(Fault::Lost(format!("cannot open a WebSocket: {e}"))),
        }
    }

    /// The service's version, which the service reports only over HTTP, on the port of the WebSocket; `None` if it
    /// reports no version.
    pub fn version(&self) -> Option<String> {
        #[derive(Deserialize)]
        struct Version {
            project_version: String,
        }
        let mut stream = Timed::connect(self.peer, VERSION_WAIT).ok()?;
        let request = format!("GET /version HTTP/1.0\r\nHost: {}\r\nConnection: close\r\n\r\n", self.peer);
        stream.write_all(request.as_bytes()).ok()?;
        let mut answer = BufReader::new(stream.take(LARGEST_VERSION));
        let mut line = String::new();
        answer.read_line(&mut line).ok()?;
        if line.split(' ').nth(1) != Some("200") {
            return None;
        }
        while !line.trim_end().is_empty() {
            line.clear();
            answer.read_line(&mut line).ok()?;
        }
        // The deserializer reads no further than the end of the value: a service may leave the connection open.
        let version = Version::deserialize(&mut serde_json::Deserializer::from_reader(answer)).ok()?;
        Some(version.project_version)
    }

    /// The next text message that arrives by `deadline`; `None` if no text arrives until then. If the deadline is past,
    /// only a message that has already arrived is returned.
    ///
    /// # Errors
    /// [`Fault::Garbled`] for a binary message or one that is too large, [`Fault::Lost`] where the connection has
    /// ended.
    pub fn receive(&mut self, deadline: Instant) -> Result<Option<Utf8Bytes>, Fault> {
        self.socket.get_mut().deadline = deadline;
        for _ in 0..MOST_OTHERS {
            match self.socket.read() {
                Ok(Message::Text(text)) => return Ok(Some(text)),
                Ok(Message::Binary(_)) => return Err(Fault::Garbled("a binary message instead of text".into())),
                Ok(Message::Close(_)) => return Err(Fault::Lost("the service closed the connection".into())),
                Ok(_) => {}
                Err(Error::Io(e)) if e.kind() == ErrorKind::WouldBlock => return Ok(None),
                Err(e @ (Error::Io(_) | Error::ConnectionClosed | Error::AlreadyClosed)) => return Err(lost(&e)),
                Err(e @ Error::Protocol(ProtocolError::ResetWithoutClosingHandshake)) => return Err(lost(&e)),
                Err(e) => return Err(Fault::Garbled(e.to_string())),
            }
        }
        Err(Fault::Garbled(format!("{MOST_OTHERS} messages in a row without text")))
    }

    /// Sends a text message.
    ///
    /// # Errors
    /// [`Fault::Lost`] if the service does not accept the message in time.
    pub fn send(&mut self, text: String) -> Result<(), Fault> {
        self.socket.get_mut().deadline = Instant::now() + SEND_WAIT;
        self.socket.send(Message::text(text)).map_err(|e| lost(&e))
    }

    /// Closes the connection so that the last message still arrives. All input is read first, because TCP resets a
    /// connection that is closed with unread input, and may then discard what was sent.
    pub fn close(mut self) {
        let deadline = Instant::now() + SEND_WAIT;
        self.socket.get_mut().deadline = deadline;
        let _ = self.socket.close(None);
        let stream = self.socket.get_mut();
        let _ = stream.stream.shutdown(Shutdown::Write);
        let mut rest = [0; 4096];
        while Instant::now() < deadline && stream.read(&mut rest).is_ok_and(|count| count > 0) {}
    }
}

/// A TCP stream on which no call waits beyond a deadline, however slowly the peer sends.
struct Timed {
    stream: TcpStream,
    deadline: Instant,
}

impl Timed {
    fn connect(peer: SocketAddr, wait: Duration) -> io::Result<Timed> {
        let deadline = Instant::now() + wait;
        let stream = TcpStream::connect_timeout(&peer, wait)?;
        stream.set_nodelay(true)?;
        Ok(Timed { stream, deadline })
    }

    fn left(&self) -> Duration {
        self.deadline.saturating_duration_since(Instant::now())
    }
}

/// Gives a timeout the error kind `WouldBlock`, because the kind that a timeout has differs between operating systems.
fn late(e: io::Error) -> io::Error {
    if e.kind() == ErrorKind::TimedOut { ErrorKind::WouldBlock.into() } else { e }
}

impl Read for Timed {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = self.left();
        if left.is_zero() {
            self.stream.set_nonblocking(true)?;
            let read = self.stream.read(buffer);
            self.stream.set_nonblocking(false)?;
            return read;
        }
        self.stream.set_read_timeout(Some(left))?;
        self.stream.read(buffer).map_err(late)
    }
}

impl Write for Timed {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let left = self.left();
        if left.is_zero() {
            return Err(ErrorKind::WouldBlock.into());
        }
        self.stream.set_write_timeout(Some(left))?;
        self.stream.write(buffer).map_err(late)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_this_machine_unless_told_otherwise() {
        for url in
            ["ws://localhost:10001", "ws://127.0.0.1", "ws://127.8.9.10:7/x", "ws://[::1]:10001", "ws://LOCALHOST"]
        {
            assert!(Address::new(url, false).is_ok(), "address {url} must be accepted");
        }
        let remote =
            ["ws://192.168.0.7:10001", "ws://example.org", "ws://localhost.example.org", "ws://0.0.0.0", "ws://[::2]"];
        for url in remote {
            assert!(
                matches!(Address::new(url, false), Err(Fault::Lost(why)) if why.contains("trusted")),
                "address {url} must be refused"
            );
            assert!(Address::new(url, true).is_ok(), "trusted address {url} must be accepted");
        }
        for url in [
            "",
            "localhost",
            "wss://localhost:10001",
            "http://localhost:10001",
            "ws://",
            "ws://localhost:99999",
            "ws://a@localhost",
        ] {
            assert!(
                matches!(Address::new(url, true), Err(Fault::Lost(why)) if why.contains("ws://localhost")),
                "address {url} must be refused"
            );
        }
    }

    #[test]
    fn a_trusted_name_may_resolve_to_anywhere_and_an_untrusted_one_may_not() {
        let mut address = Address::new("ws://192.168.0.7:10001", true).unwrap();
        assert_eq!(address.resolve().unwrap().len(), 1);
        address.trust_remote = false;
        assert!(address.resolve().is_err());
    }
}
