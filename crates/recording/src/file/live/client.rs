//! Which clients may connect, how many, and what each of them is sent.

use core::sync::atomic::Ordering;
use core::time::Duration;
use std::collections::BTreeMap;
use std::sync::Arc;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use futures_util::{SinkExt as _, StreamExt as _};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{Semaphore, broadcast, watch};
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tokio_tungstenite::tungstenite::http::{HeaderMap, HeaderValue, StatusCode, header};
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::tungstenite::{Bytes, Message};
use tokio_tungstenite::{WebSocketStream, accept_hdr_async_with_config};

use super::super::channels::Channel;
use super::super::messages::Occasion;
use super::{Counts, LiveMessage, channel_id, occasion_id};

/// Clients at the same time.
pub(super) const MOST_CLIENTS: usize = 8;
/// A request for a WebSocket comes within this time.
const HEAD_PATIENCE: Duration = Duration::from_secs(5);
/// What a client may send on one connection in all, bytes: a subscription takes fifty.
const MOST_SAID_BYTES: usize = 1 << 20;
/// A client that takes nothing for so long is cut off.
const STALLED: Duration = Duration::from_secs(10);
/// Rest after an error that is not the fault of one connection, such as too many open files.
const AFTER_ERROR: Duration = Duration::from_millis(50);
/// Subscriptions of one client: every message of a topic is sent once for each.
const MOST_SUBSCRIPTIONS: usize = 64;
/// A client is shown the scene so often when it asks again and again: it may be long.
const MOST_SCENES: u32 = 8;
/// The page of the Foxglove app.
const FOXGLOVE_APP: &str = "https://app.foxglove.dev";
/// What the server speaks.
const PROTOCOL: &str = "foxglove.sdk.v1";
const NO_SLOT: &[u8] =
    b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n";

/// What every client gets.
pub(super) struct Gate {
    pub(super) messages: broadcast::Sender<LiveMessage>,
    pub(super) scene: watch::Receiver<Option<LiveMessage>>,
    /// Web pages that are welcome.
    pub(super) origins: Vec<String>,
    pub(super) counts: Arc<Counts>,
}

/// Why a connection is over.
enum Over {
    /// The client has gone, or makes no sense.
    Gone,
    /// It took nothing for too long.
    Stalled,
}

type Socket = WebSocketStream<TcpStream>;

/// What a client says.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Asked {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: u32,
}

impl Gate {
    /// For ever. `slots`: one for each client.
    pub(super) async fn run(self, listener: TcpListener, slots: Arc<Semaphore>) {
        loop {
            let Ok((client, _)) = listener.accept().await else {
                tokio::time::sleep(AFTER_ERROR).await;
                continue;
            };
            let Ok(slot) = slots.clone().try_acquire_owned() else {
                self.counts.turned_away.fetch_add(1, Ordering::Relaxed);
                // Written into an empty buffer: it fits.
                let _ = client.try_write(NO_SLOT);
                continue;
            };
            // No sender: the queue ends when the gate does.
            let messages = self.messages.subscribe();
            let scene = self.scene.clone();
            let origins = self.origins.clone();
            let counts = self.counts.clone();
            tokio::spawn(async move {
                let Some(socket) = accepted(client, &origins, &counts).await else { return };
                let client = Client { socket, scene, subscriptions: BTreeMap::new(), greeted: 0 };
                if let Err(Over::Stalled) = client.serve(messages).await {
                    counts.cut_off.fetch_add(1, Ordering::Relaxed);
                }
                drop(slot);
            });
        }
    }
}

/// The connection, where its page is welcome.
async fn accepted(client: TcpStream, origins: &[String], counts: &Counts) -> Option<Socket> {
    client.set_nodelay(true).ok()?;
    let refused = |status: StatusCode| {
        let mut response = ErrorResponse::new(None);
        *response.status_mut() = status;
        response
    };
    #[expect(clippy::result_large_err, reason = "tungstenite's callback has this type")]
    let check = |request: &Request, mut response: Response| {
        if !welcomes(request.headers(), origins) {
            counts.turned_away.fetch_add(1, Ordering::Relaxed);
            return Err(refused(StatusCode::FORBIDDEN));
        }
        let offered = request.headers().get_all(header::SEC_WEBSOCKET_PROTOCOL);
        let mut offered = offered.iter().filter_map(|offered| offered.to_str().ok());
        if !offered.any(|names| names.split(',').any(|name| name.trim() == PROTOCOL)) {
            return Err(refused(StatusCode::BAD_REQUEST));
        }
        let protocol = HeaderValue::from_static(PROTOCOL);
        response.headers_mut().insert(header::SEC_WEBSOCKET_PROTOCOL, protocol);
        Ok(response)
    };
    let limits = WebSocketConfig::default()
        .max_message_size(Some(MOST_SAID_BYTES))
        .max_frame_size(Some(MOST_SAID_BYTES));
    let accepting = accept_hdr_async_with_config(client, check, Some(limits));
    timeout(HEAD_PATIENCE, accepting).await.ok()?.ok()
}

/// A web page that the operator has open can connect too. It betrays itself by its `Origin`;
/// programs send none, or none of the web.
fn welcomes(headers: &HeaderMap, origins: &[String]) -> bool {
    headers.get_all(header::ORIGIN).iter().all(|origin| {
        origin.to_str().is_ok_and(|origin| {
            origin == FOXGLOVE_APP || origins.iter().any(|known| known == origin) || {
                let lower = origin.to_lowercase();
                match lower.strip_prefix("http://").or(lower.strip_prefix("https://")) {
                    Some(host) => ["localhost", "127.0.0.1", "[::1]"].iter().any(|ours| {
                        host.strip_prefix(ours)
                            .is_some_and(|rest| rest.is_empty() || rest.starts_with(':'))
                    }),
                    // A page without a name of its own says `null`; `file:` and the like are
                    // programs.
                    None => lower != "null",
                }
            }
        })
    })
}

/// One client.
struct Client {
    socket: Socket,
    scene: watch::Receiver<Option<LiveMessage>>,
    /// Channels by the numbers of their subscriptions.
    subscriptions: BTreeMap<u32, u32>,
    /// How often it was shown the scene because it asked.
    greeted: u32,
}

impl Client {
    /// Until it goes, or the run ends.
    async fn serve(mut self, mut messages: broadcast::Receiver<LiveMessage>) -> Result<(), Over> {
        let info = json!({ "op": "serverInfo", "name": "hapticd", "capabilities": [] });
        self.send(Message::text(info.to_string())).await?;
        let advertised = json!({ "op": "advertise", "channels": advertised() });
        self.send(Message::text(advertised.to_string())).await?;
        let mut left_bytes = MOST_SAID_BYTES;
        loop {
            tokio::select! {
                biased;
                Ok(()) = self.scene.changed() => {
                    let scene = self.scene.borrow_and_update().clone();
                    if let Some(scene) = scene {
                        self.pass_on(&scene).await?;
                    }
                }
                said = self.socket.next() => {
                    let said = said.and_then(Result::ok).ok_or(Over::Gone)?;
                    left_bytes = left_bytes.checked_sub(said.len()).ok_or(Over::Gone)?;
                    self.hear(&said).await?;
                }
                message = messages.recv() => match message {
                    Ok(message) => self.pass_on(&message).await?,
                    // The oldest go first.
                    Err(RecvError::Lagged(_)) => {}
                    Err(RecvError::Closed) => {
                        let _ = self.socket.close(None).await;
                        return Ok(());
                    }
                }
            }
        }
    }

    /// What makes no sense changes nothing.
    async fn hear(&mut self, said: &Message) -> Result<(), Over> {
        let Message::Text(text) = said else { return Ok(()) };
        match serde_json::from_str(text) {
            Ok(Asked::Subscribe { subscriptions }) => {
                for Subscription { id, channel_id } in subscriptions {
                    if !subscribe(&mut self.subscriptions, id, channel_id) {
                        continue;
                    }
                    let asks_for_scene = channel_id == occasion_id(Occasion::Scene);
                    let scene = self.scene.borrow_and_update().clone();
                    if let Some(scene) =
                        scene.filter(|_| asks_for_scene && self.greeted < MOST_SCENES)
                    {
                        self.greeted += 1;
                        self.send(data(id, &scene)).await?;
                    }
                }
            }
            Ok(Asked::Unsubscribe { subscription_ids }) => {
                for id in subscription_ids {
                    self.subscriptions.remove(&id);
                }
            }
            Err(_) => {}
        }
        Ok(())
    }

    async fn pass_on(&mut self, message: &LiveMessage) -> Result<(), Over> {
        let wanted = |(id, channel): (&u32, &u32)| (*channel == message.channel_id).then_some(*id);
        let ids: Vec<u32> = self.subscriptions.iter().filter_map(wanted).collect();
        for id in ids {
            self.send(data(id, message)).await?;
        }
        Ok(())
    }

    async fn send(&mut self, message: Message) -> Result<(), Over> {
        let sent = timeout(STALLED, self.socket.send(message)).await.map_err(|_| Over::Stalled)?;
        sent.map_err(|_| Over::Gone)
    }
}

/// False where the client has as many subscriptions as it may: a new one is ignored.
fn subscribe(subscriptions: &mut BTreeMap<u32, u32>, id: u32, channel_id: u32) -> bool {
    let has_room = subscriptions.len() < MOST_SUBSCRIPTIONS || subscriptions.contains_key(&id);
    if has_room {
        subscriptions.insert(id, channel_id);
    }
    has_room
}

/// A message of a subscription.
fn data(subscription_id: u32, LiveMessage { stamp_ns, bytes, .. }: &LiveMessage) -> Message {
    let mut frame = Vec::with_capacity(13 + bytes.len());
    frame.push(1);
    frame.extend(subscription_id.to_le_bytes());
    frame.extend(stamp_ns.to_le_bytes());
    frame.extend_from_slice(bytes);
    Message::Binary(Bytes::from(frame))
}

/// The topics, as clients are told of them.
fn advertised() -> Vec<Value> {
    let ticks =
        Channel::ALL.map(|channel| (channel_id(channel), channel.topic(), channel.schema()));
    let occasions =
        Occasion::ALL.map(|occasion| (occasion_id(occasion), occasion.topic(), occasion.schema()));
    let channel = |(id, topic, (name, schema)): (u32, &str, (String, Vec<u8>))| {
        json!({
            "id": id,
            "topic": topic,
            "encoding": "protobuf",
            "schemaName": name,
            "schema": BASE64_STANDARD.encode(schema),
            "schemaEncoding": "protobuf",
        })
    };
    ticks.into_iter().chain(occasions).map(channel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_has_so_many_subscriptions_and_no_more() {
        let mut subscriptions = BTreeMap::new();
        let taken = (0..1000).filter(|id| subscribe(&mut subscriptions, *id, 1)).count();
        assert_eq!((taken, subscriptions.len()), (MOST_SUBSCRIPTIONS, MOST_SUBSCRIPTIONS));
        assert!(subscribe(&mut subscriptions, 0, 2) && subscriptions[&0] == 2, "one that it has");
    }

    #[test]
    fn web_pages_of_others_do_not_come_in() {
        let welcomes = |origin: &str| {
            let headers = HeaderMap::from_iter([(header::ORIGIN, origin.parse().expect("text"))]);
            super::welcomes(&headers, &["https://lab.example".to_owned()])
        };
        for origin in [
            "http://localhost:8080",
            "http://127.0.0.1",
            "https://[::1]:1",
            FOXGLOVE_APP,
            "https://lab.example",
            "file://",
        ] {
            assert!(welcomes(origin), "{origin}");
        }
        for origin in [
            "http://evil.example",
            "null",
            "http://localhost.evil.example",
            "https://127.0.0.1.evil.example",
            "HTTP://x",
        ] {
            assert!(!welcomes(origin), "{origin}");
        }
        assert!(super::welcomes(&HeaderMap::new(), &[]), "a program");
    }
}
