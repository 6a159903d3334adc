//! One WebSocket: requests in, words and states out.

use core::time::Duration;
use std::error::Error;
use std::io;
use std::sync::Arc;

use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use axum::extract::{ConnectInfo, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use tokio::sync::OwnedSemaphorePermit;

use super::answer::Completion;
use super::app_state::AppState;
use super::asks::{ClientCommand, perform};
use super::client::Client;
use super::connection::Peer;
use super::encode;
use super::outbox::{OutboxAction, POLICY};
use super::problem::RequestError;
use super::rate_limiter::TokenBucket;

/// Largest message of a client, bytes.
const MOST_BYTES: usize = 64 << 10;
/// Requests of one client a second, and at once. More are refused.
const MOST_PER_S: f64 = 2000.0;
const MOST_AT_ONCE: f64 = 2000.0;
/// Messages of one client after which all other work of this thread gets its turn, replies to this
/// client among it. Messages that were read together come without a pause.
const MOST_IN_A_TURN: u32 = 64;
/// A client that takes nothing for so long is disconnected.
const STALLED: Duration = Duration::from_secs(5);
/// A WebSocket on which nothing else happens.
const PING_EVERY: Duration = Duration::from_secs(10);
/// How long a good-bye may take.
const GOOD_BYE: Duration = Duration::from_secs(1);

/// Normal end, broken protocol, a kind of data that is not taken, too large (RFC 6455).
const NORMAL: u16 = 1000;
const PROTOCOL: u16 = 1002;
const UNSUPPORTED: u16 = 1003;
const TOO_LARGE: u16 = 1009;

/// `/api/v1/ws`.
pub(super) async fn open(
    State(state): State<Arc<AppState>>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let upgrade = match upgrade {
        Ok(upgrade) => upgrade,
        Err(rejection) => {
            return RequestError::new(
                StatusCode::BAD_REQUEST,
                rejection.body_text(),
                "open this address as a WebSocket",
            )
            .into_response();
        }
    };
    let Ok(seat) = state.seats.clone().try_acquire_owned() else {
        return RequestError::unavailable("too many WebSockets", "close some, or try again later")
            .into_response();
    };
    let upgrade = upgrade
        .max_message_size(MOST_BYTES)
        .max_frame_size(MOST_BYTES)
        .read_buffer_size(8 << 10)
        .write_buffer_size(0);
    upgrade.on_upgrade(move |socket| async move {
        peer.become_web_socket();
        serve(&state, socket, peer, seat).await;
    })
}

async fn serve(state: &Arc<AppState>, socket: WebSocket, peer: Peer, _seat: OwnedSemaphorePermit) {
    let client = state.hub.join(peer.state);
    let _parted = Parted { state, id: client.id };
    let (sink, stream) = socket.split();
    let sending = send_all(sink, &client);
    let taking = take_all(stream, state, &client);
    tokio::pin!(sending, taking);
    tokio::select! {
        () = &mut sending => {
            state.hub.part(client.id);
            // What the kernel has received and this program has not read would make it reset the
            // connection, and the good-bye would be lost with that.
            let _ = tokio::time::timeout(GOOD_BYE, taking).await;
        }
        () = &mut taking => {
            // The watchdog forgets it at once; what is left to be said goes out, if the client
            // still reads.
            state.hub.part(client.id);
            let _ = tokio::time::timeout(GOOD_BYE, sending).await;
        }
    }
}

/// However a connection ends, the hub is notified.
struct Parted<'s> {
    state: &'s Arc<AppState>,
    id: u64,
}

impl Drop for Parted<'_> {
    fn drop(&mut self) {
        self.state.hub.part(self.id);
    }
}

async fn send_all(mut sink: SplitSink<WebSocket, Message>, client: &Client) {
    let mut ping = tokio::time::interval(PING_EVERY);
    ping.tick().await;
    loop {
        let messages = tokio::select! {
            next = client.outbox.next() => match next {
                OutboxAction::Send(messages) => messages,
                OutboxAction::Close(code, reason) => {
                    let close = Message::Close(Some(CloseFrame { code, reason: reason.into() }));
                    let _ = tokio::time::timeout(GOOD_BYE, sink.send(close)).await;
                    return;
                }
            },
            _ = ping.tick() => vec![Message::Ping(axum::body::Bytes::new())],
        };
        let sent = async {
            for message in messages {
                sink.feed(message).await?;
            }
            sink.flush().await
        };
        // Nothing that could be said after an error would arrive.
        match tokio::time::timeout(STALLED, sent).await {
            Ok(Ok(())) => {}
            Ok(Err(_)) => return,
            Err(_) => return client.outbox.expel_deaf(),
        }
    }
}

async fn take_all(mut stream: SplitStream<WebSocket>, state: &Arc<AppState>, client: &Arc<Client>) {
    let mut bucket = TokenBucket::new(MOST_PER_S, MOST_AT_ONCE);
    let mut in_turn = 0;
    while let Some(message) = stream.next().await {
        match message {
            Ok(Message::Text(text)) => take(&text, state, client, &mut bucket),
            // What comes behind it may be an order.
            Ok(Message::Binary(_)) => client.outbox.expel(UNSUPPORTED, "requests are text"),
            // Pings are answered below, and a close is the end of the stream.
            Ok(Message::Ping(_) | Message::Pong(_) | Message::Close(_)) => {}
            Err(_) if client.has_left() => break,
            Err(error) => {
                let (code, reason) = reason_of(&error);
                return client.outbox.expel(code, reason);
            }
        }
        in_turn += 1;
        if in_turn == MOST_IN_A_TURN {
            in_turn = 0;
            tokio::task::yield_now().await;
        }
    }
    client.outbox.end(NORMAL, "");
}

/// Why a connection that fails is closed: a code, and the words for its client.
fn reason_of(error: &axum::Error) -> (u16, &'static str) {
    let first: &(dyn Error + 'static) = error;
    let mut causes = core::iter::successors(Some(first), |&cause| cause.source());
    let is_silent = causes.any(|cause| {
        cause
            .downcast_ref::<io::Error>()
            .is_some_and(|error| error.kind() == io::ErrorKind::TimedOut)
    });
    if is_silent {
        (POLICY, "silent for 30 s")
    } else if error.to_string().contains("too long") {
        // The library has no other word for it.
        (TOO_LARGE, "a message has at most 65536 bytes")
    } else {
        (PROTOCOL, "not the WebSocket protocol")
    }
}

/// One message. It is parsed before it is paced: what switches force off waits for nothing, and is
/// done where no answer can arrive any more, too.
fn take(text: &str, state: &Arc<AppState>, client: &Arc<Client>, bucket: &mut TokenBucket) {
    let (id, asked) = ClientCommand::parse(text.as_bytes());
    if client.outbox.has_ended() {
        if let Ok(asked) = asked
            && asked.is_off()
        {
            perform(&state.hub, &state.files, Some(client), asked, Box::new(|_| ()));
        }
        return;
    }
    state.hub.note_message(client);
    let place = client.unanswered.clone().try_acquire_owned().ok();
    let asked = match asked {
        Ok(asked) if asked.is_always_heard() => Ok(asked),
        _ if !bucket.try_take() => Err(RequestError::too_many(format!(
            "more than {MOST_PER_S} requests a second over one WebSocket"
        ))),
        Ok(_) if place.is_none() => {
            Err(RequestError::too_many("too many requests wait for their answers"))
        }
        asked => asked,
    };
    match asked {
        Ok(asked) => {
            let to = client.clone();
            let reply = Box::new(move |result| {
                to.outbox.say(reply(&id, result));
                drop(place);
            });
            perform(&state.hub, &state.files, Some(client), asked, reply);
        }
        Err(problem) => client.outbox.say(reply(&id, Err(problem))),
    }
}

/// The answer to one request.
fn reply(id: &Value, result: Result<Completion, RequestError>) -> String {
    encode::json(&match result {
        Ok(done) => {
            let mut answer = json!({ "type": "reply", "id": id, "ok": true });
            done.tell(&mut answer);
            answer
        }
        Err(RequestError { said, status }) => json!({
            "type": "reply",
            "id": id,
            "ok": false,
            "status": status.as_u16(),
            "error": said.error,
            "hint": said.hint,
        }),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_and_what_is_no_protocol_are_told_apart() {
        let silent = axum::Error::new(axum::Error::new(io::Error::from(io::ErrorKind::TimedOut)));
        assert_eq!(reason_of(&silent), (POLICY, "silent for 30 s"));
        assert_eq!(reason_of(&axum::Error::new("Message too long: 70000 > 65536")).0, TOO_LARGE);
        let broken = axum::Error::new(io::Error::from(io::ErrorKind::InvalidData));
        assert_eq!(reason_of(&broken), (PROTOCOL, "not the WebSocket protocol"));
    }
}
