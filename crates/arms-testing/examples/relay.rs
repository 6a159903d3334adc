//! Passes the bytes of TCP connections on, until it is killed: what may die between a test and a
//! service whose arm lives on.
//!
//! ```sh
//! cargo run -p arms-testing --example relay -- 127.0.0.1:4000 127.0.0.1:10001
//! ```

use std::io::{Error, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::thread;

/// Passes on what comes, until either end has gone.
fn pass_on(mut from: TcpStream, mut to: TcpStream) {
    let mut buffer = [0; 4096];
    while let Ok(n @ 1..) = from.read(&mut buffer) {
        if to.write_all(&buffer[..n]).is_err() {
            break;
        }
    }
    // One that has gone already refuses.
    let _ = (from.shutdown(Shutdown::Both), to.shutdown(Shutdown::Both));
}

fn main() -> Result<(), Error> {
    let mut addresses = std::env::args().skip(1);
    let (Some(from), Some(to)) = (addresses.next(), addresses.next()) else {
        return Err(Error::other(
            "two addresses are missing: where it listens, and where it passes bytes on to",
        ));
    };
    for near in TcpListener::bind(from)?.incoming() {
        let near = near?;
        let far = TcpStream::connect(&to)?;
        for stream in [&near, &far] {
            // One that has gone already refuses.
            let _ = stream.set_nodelay(true);
        }
        let near_too = near.try_clone()?;
        let far_too = far.try_clone()?;
        thread::spawn(move || pass_on(near, far));
        thread::spawn(move || pass_on(far_too, near_too));
    }
    Ok(())
}
