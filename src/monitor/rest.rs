//! HTTP: the page, facts, and requests of clients that keep no connection.

use core::time::Duration;
use std::path::PathBuf;
use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::rejection::{BytesRejection, QueryRejection};
use axum::extract::{ConnectInfo, DefaultBodyLimit, FromRequest, Path, Query, Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Redirect, Response};
use axum::routing::{MethodRouter, delete, get, post, put};
use axum::{Json, Router};
use glam::DVec3;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use tokio::sync::oneshot;

use super::answer::Reply;
use super::app_state::AppState;
use super::asks::{ClientCommand, perform};
use super::clay::{
    IMAGE_BYTES_MAX, SOLID_BYTES_MAX, SolidAsked, VALUES_BYTES_MAX, ValuesAsked, image_of,
    solid_of, values_of,
};
use super::compressed::Compressed;
use super::connection::Peer;
use super::encode::{WirePose, with_counts};
use super::forms::{read, such_as};
use super::problem::RequestError;
use super::structure::{self, Structure};
use super::visual::{self, Visual};
use super::{assets, clearance, download, recordings, ws};
use crate::daemon::scenes_beside;
use crate::daemon::session::SceneView;
use ::clay::engine::{SculptOrder, ToolChange};
use arms::simulated::hand::HandPath;
use recording::metrics;
use rt::process::give_back_memory;

/// Largest body of a request, bytes.
const MOST_BYTES: usize = 64 << 10;
/// Longest address, bytes.
const LONGEST_URI: usize = 2048;
/// Longest refusal in the words of the framework, bytes.
const LONGEST_REFUSAL: usize = 1024;
/// A request that takes longer goes on; its outcome is sent as an event.
const PATIENCE: Duration = Duration::from_secs(2);
/// A file for the clay that is not whole after so long is refused: others wait behind it. A
/// connection on which nothing comes is closed later, so that this can be answered.
const UPLOAD: Duration = Duration::from_secs(20);

/// Type of what is no text.
const BYTES: &str = "application/octet-stream";

/// A page loads nothing from elsewhere, and no other page may frame it.
const POLICY: &str = "default-src 'self'; connect-src 'self'; img-src 'self' data: blob:; \
    frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

pub(super) fn router(app: Arc<AppState>) -> Router {
    let api = Router::new()
        .route("/api/v1/info", get(info))
        .route("/api/v1/state", get(state))
        .route("/api/v1/scene", get(scene).merge(command("switch")))
        .route("/api/v1/scene/{scene_idx}/mesh/{object_idx}", get(mesh))
        .route("/api/v1/scene/{scene_idx}/voxels/{object_idx}", structure(Structure::Voxels))
        .route("/api/v1/scene/{scene_idx}/pointshell/{object_idx}", structure(Structure::Points))
        .route("/api/v1/scenes", get(scenes))
        .route("/api/v1/parameters", get(parameters))
        .route("/api/v1/parameters/{name}", put(set))
        .route("/api/v1/objects/{name}/pose", put(place))
        .route("/api/v1/hand", command("hand"))
        .route("/api/v1/hand/restart", command("restart_hand"))
        .route("/api/v1/scene/reset", command("reset"))
        .route("/api/v1/enable", command("enable"))
        // These are done whatever comes with them.
        .route(
            "/api/v1/disable",
            post(async |State(state): State<Arc<AppState>>| {
                done(&state, ClientCommand::Disable {}).await
            }),
        )
        .route(
            "/api/v1/stop",
            post(async |State(state): State<Arc<AppState>>| {
                done(&state, ClientCommand::Stop {}).await
            }),
        )
        .route("/api/v1/recording", command("record"))
        .route(
            "/api/v1/recording",
            delete(async |State(state): State<Arc<AppState>>| {
                done(&state, ClientCommand::EndRecording {}).await
            }),
        )
        .route("/api/v1/clearance", get(clearance::clearance))
        .route("/api/v1/recordings", get(recordings::list))
        .route("/api/v1/recordings/{number}", get(recordings::file))
        .route("/api/v1/recordings/{number}/report", get(recordings::report))
        .route("/api/v1/clay", get(clay))
        .route("/api/v1/clay/points", get(clay_points))
        .route("/api/v1/clay/files", get(clay_files))
        .route("/api/v1/clay/files/{number}", get(clay_file))
        .route("/api/v1/clay/tool", command("clay_take"))
        .route("/api/v1/clay/draw", command("clay_draw"))
        .route("/api/v1/clay/pull", command("clay_pull"))
        .route("/api/v1/clay/region", command("clay_region"))
        .route("/api/v1/clay/lay", command("clay_lay"))
        .route("/api/v1/clay/combine", command("clay_combine"))
        .route(
            "/api/v1/clay/image",
            put(clay_image).delete(no_clay_image).layer(DefaultBodyLimit::max(IMAGE_BYTES_MAX)),
        )
        .route(
            "/api/v1/clay/solid",
            put(clay_solid).delete(no_clay_solid).layer(DefaultBodyLimit::max(SOLID_BYTES_MAX)),
        )
        .route(
            "/api/v1/clay/values",
            put(clay_values).layer(DefaultBodyLimit::max(VALUES_BYTES_MAX)),
        )
        .route("/api/v1/clay/undo", command("clay_undo"))
        .route("/api/v1/clay/redo", command("clay_redo"))
        .route("/api/v1/clay/save", command("clay_save"))
        .route("/metrics", get(metrics))
        .layer(middleware::from_fn_with_state(app.clone(), paced))
        .route("/api/v1/ws", get(ws::open))
        .fallback(nothing)
        .method_not_allowed_fallback(wrong_method)
        .layer(middleware::from_fn_with_state(app.clone(), let_in));
    let page = Router::new()
        .route("/", get(|headers: HeaderMap| page_file("index.html".to_owned(), headers)))
        .route("/index.html", get(|| async { Redirect::permanent("/") }))
        .route("/favicon.ico", get(|| async { StatusCode::NO_CONTENT }))
        .route(
            "/web/{name}",
            get(|Path(name): Path<String>, headers: HeaderMap| page_file(name, headers)),
        )
        .layer(middleware::from_fn_with_state(app.clone(), show));
    api.merge(page)
        .layer(DefaultBodyLimit::max(MOST_BYTES))
        .layer(middleware::map_response(in_our_words))
        .layer(middleware::map_response(hardened))
        .with_state(app)
}

/// A client without access gets the reason.
async fn let_in(
    State(state): State<Arc<AppState>>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    request: Request,
    next: Next,
) -> Response {
    if request.uri().path_and_query().is_some_and(|path| path.as_str().len() > LONGEST_URI) {
        return RequestError::new(StatusCode::URI_TOO_LONG, "the address is too long", "")
            .into_response();
    }
    let allowed = if is_off(&request) {
        state.access.may_switch_off(request.headers()).map(|()| peer.looks())
    } else {
        state.access.may_ask(request.headers(), request.uri().query()).map(|()| peer.let_in())
    };
    match allowed {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

/// It switches force off.
fn is_off(request: &Request) -> bool {
    request.method() == Method::POST
        && matches!(request.uri().path(), "/api/v1/disable" | "/api/v1/stop")
}

async fn show(
    State(state): State<Arc<AppState>>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    request: Request,
    next: Next,
) -> Response {
    match state.access.may_see_page(request.headers()) {
        Ok(()) => {
            peer.looks();
            next.run(request).await
        }
        Err(problem) => problem.into_response(),
    }
}

/// A client that asks too often gets that answer; what switches force off is always done.
async fn paced(
    State(state): State<Arc<AppState>>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    request: Request,
    next: Next,
) -> Response {
    if is_off(&request) || state.rate_limiter.allows(peer.address.ip()) {
        return next.run(request).await;
    }
    RequestError::new(
        StatusCode::TOO_MANY_REQUESTS,
        "too many requests",
        "use the WebSocket for what comes often",
    )
    .into_response()
}

/// What the framework refuses before a handler gets it is said in the same form as everything else.
async fn in_our_words(response: Response) -> Response {
    let is_refusal = response.status().is_client_error() || response.status().is_server_error();
    let is_json =
        response.headers().get(header::CONTENT_TYPE).is_some_and(|kind| kind == "application/json");
    if !is_refusal || is_json {
        return response;
    }
    let (head, body) = response.into_parts();
    if head.status == StatusCode::PAYLOAD_TOO_LARGE {
        return RequestError::new(
            head.status,
            format!("a body has at most {MOST_BYTES} bytes"),
            "an image of clay 4 MiB, a solid and values of material 16 MiB",
        )
        .into_response();
    }
    let text = axum::body::to_bytes(body, LONGEST_REFUSAL).await.unwrap_or_default();
    RequestError::new(
        head.status,
        String::from_utf8_lossy(&text),
        "docs/reference/api.md lists what there is",
    )
    .into_response()
}

async fn hardened(mut response: Response) -> Response {
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(HeaderValue::from_static(POLICY));
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

async fn page_file(name: String, headers: HeaderMap) -> Response {
    match assets::find(&name) {
        Some((kind, file)) => file.response(&headers, kind),
        None => nothing().await.into_response(),
    }
}

async fn nothing() -> RequestError {
    RequestError::new(
        StatusCode::NOT_FOUND,
        "there is nothing here",
        "docs/reference/api.md lists what there is",
    )
}

async fn wrong_method() -> RequestError {
    RequestError::new(
        StatusCode::METHOD_NOT_ALLOWED,
        "not with this method",
        "docs/reference/api.md lists what there is",
    )
}

async fn info(State(state): State<Arc<AppState>>) -> Json<Value> {
    Json(state.hub.info())
}

async fn state(State(state): State<Arc<AppState>>) -> Result<Response, RequestError> {
    let body = state.hub.state_text().ok_or_else(|| {
        RequestError::unavailable("no tick was rendered yet", "wait for the event `scene`")
    })?;
    Ok(([(header::CONTENT_TYPE, "application/json")], with_counts(&body, 0, 0)).into_response())
}

async fn metrics(State(state): State<Arc<AppState>>) -> Result<Response, RequestError> {
    let metrics = state
        .hub
        .metrics()
        .ok_or_else(|| RequestError::unavailable("this run has no metrics", ""))?;
    Ok(([(header::CONTENT_TYPE, metrics::CONTENT_TYPE)], metrics).into_response())
}

async fn scene(State(state): State<Arc<AppState>>) -> Result<Json<Value>, RequestError> {
    let view = state.hub.session.view();
    let Some(scene) = &view.scene else {
        return Err(RequestError::unavailable(
            "the scene is being baked",
            "wait for the event `scene`",
        ));
    };
    let config = &view.config;
    let tool = ("tool", "tool", false, config.parameters.mapping.start, config.tool.voxel_size_m);
    let statics = config.statics.iter().map(|object| {
        (&object.name[..], "static", object.movable, object.pose, object.voxel_size_m)
    });
    let mut objects = Vec::new();
    let mut bounds: Option<[DVec3; 2]> = None;
    let mut finest_m = f64::INFINITY;
    let mut tool_bounds = None;
    for (idx, (name, role, movable, pose, voxel_size_m)) in statics.chain([tool]).enumerate() {
        let visual = self::visual(&state, &view, idx).await;
        let visual = visual.as_deref();
        if role == "tool" {
            tool_bounds = visual.and_then(|visual| visual.bounds);
        }
        if let Some(own) = visual.and_then(|visual| visual.bounds) {
            bounds = Some(
                corners(own)
                    .fold(bounds, |bounds, corner| grown(bounds, pose.transform_point(corner)))
                    .unwrap_or(own),
            );
        }
        finest_m = finest_m.min(voxel_size_m);
        objects.push(json!({
            "name": name,
            "role": role,
            "movable": movable,
            "pose": WirePose::from(pose),
            "voxel_size_m": voxel_size_m,
            "report": view.reports.get(idx),
            "triangles": visual.map(|visual| visual.triangles),
            "shown_triangles": visual.map(|visual| visual.shown_triangles),
            "mesh": visual.map(|_| format!("/api/v1/scene/{}/mesh/{idx}", view.scene_idx)),
            "voxels": visual.map(|_| format!("/api/v1/scene/{}/voxels/{idx}", view.scene_idx)),
            "pointshell": visual.map(|_| format!("/api/v1/scene/{}/pointshell/{idx}", view.scene_idx)),
        }));
    }
    let hand = config.device.hand.clone().filter(|_| config.device.profile.real.is_none());
    let hand_bounds = match hand.zip(tool_bounds) {
        Some((hand, tool)) => state.files.run(move || along_path(&hand, tool)).await.flatten(),
        None => None,
    };
    Ok(Json(json!({
        "scene_idx": view.scene_idx,
        "name": config.name,
        "file": config.path.to_string_lossy(),
        "voxel_size_m": finest_m,
        "points": scene.tool.shell.len(),
        "world_from_device": WirePose::from(config.parameters.mapping.world_from_device),
        "objects": objects,
        "clay": state.hub.clay().is_ok(),
        "movable": view.movable,
        "hand": view.has_hand.then(|| json!({ "path": config.device.hand.is_some() })),
        "bounds": bounds.map(|[low, high]| json!({ "min": low.to_array(), "max": high.to_array() })),
        "switching_to": view.switching_to.as_ref().map(|path| path.to_string_lossy()),
        "hand_bounds": hand_bounds.map(|[low, high]| json!({ "min": low.to_array(), "max": high.to_array() })),
    })))
}

/// Box around a tool along the path that a hand takes it, world; `None`: the file of the path is
/// gone.
fn along_path(hand: &std::path::Path, tool: [DVec3; 2]) -> Option<[DVec3; 2]> {
    let path = HandPath::read(hand).ok()?;
    let places = path
        .poses()
        .iter()
        .flat_map(|pose| corners(tool).map(|corner| pose.transform_point(corner)));
    places.fold(None, grown)
}

fn corners([low, high]: [DVec3; 2]) -> impl Iterator<Item = DVec3> {
    (0..8).map(move |n| {
        let pick = |bit: usize, low: f64, high: f64| if n & bit == 0 { low } else { high };
        DVec3::new(pick(1, low.x, high.x), pick(2, low.y, high.y), pick(4, low.z, high.z))
    })
}

fn grown(bounds: Option<[DVec3; 2]>, point: DVec3) -> Option<[DVec3; 2]> {
    Some(bounds.map_or([point; 2], |[low, high]| [low.min(point), high.max(point)]))
}

/// What a client may ask of a scene: the one that is rendered.
fn rendered(state: &AppState, scene_idx: u32) -> Result<SceneView, RequestError> {
    let view = state.hub.session.view();
    if view.scene_idx == scene_idx {
        return Ok(view);
    }
    Err(RequestError::new(
        StatusCode::NOT_FOUND,
        "this scene is not rendered",
        format!("scene {} is rendered", view.scene_idx),
    ))
}

async fn visual(state: &AppState, view: &SceneView, object_idx: usize) -> Option<Arc<Visual>> {
    let config = view.config.clone();
    let make = move || visual::make(&config, object_idx).ok_or(());
    state.visuals.get((view.scene_idx, object_idx), make).await?.ok()
}

async fn mesh(
    State(state): State<Arc<AppState>>,
    Path((scene_idx, object_idx)): Path<(u32, usize)>,
    headers: HeaderMap,
) -> Result<Response, RequestError> {
    let view = rendered(&state, scene_idx)?;
    let visual = visual(&state, &view, object_idx).await;
    let visual = visual.ok_or_else(|| {
        RequestError::new(StatusCode::NOT_FOUND, "no such object, or its mesh file is gone", "")
    })?;
    Ok(visual.file.response(&headers, BYTES))
}

fn structure(structure: Structure) -> MethodRouter<Arc<AppState>> {
    get(
        async move |State(state): State<Arc<AppState>>,
                    Path((scene_idx, object_idx)): Path<(u32, usize)>,
                    headers: HeaderMap| {
            let view = rendered(&state, scene_idx)?;
            let made = if structure == Structure::Voxels { &state.voxels } else { &state.points };
            let make = move || {
                structure::file(&view, object_idx, structure)
                    .map(|file| Compressed::new(file.into()))
            };
            let file = made.get((scene_idx, object_idx), make).await;
            let file = file.unwrap_or_else(|| {
                Err(RequestError::unavailable("the object could not be baked", "the log has more"))
            })?;
            Ok::<_, RequestError>(file.response(&headers, BYTES))
        },
    )
}

async fn scenes(State(state): State<Arc<AppState>>) -> Json<Value> {
    let view = state.hub.session.view();
    // Folders may be on a disk that takes its time.
    let names = state
        .files
        .run(move || scenes_beside(&view.config.path).into_iter().map(|(name, _)| name).collect());
    Json(names.await.unwrap_or_else(|| Value::Array(Vec::new())))
}

async fn parameters(State(state): State<Arc<AppState>>) -> Json<Value> {
    let settings = state.hub.session.view().settings;
    let parameter = |setting: &crate::daemon::session::ParameterSetting| {
        let range = setting.range;
        json!({ "name": setting.parameter.name(), "value": setting.value, "least": range.least, "most": range.most, "scene": range.scene })
    };
    Json(settings.iter().map(parameter).collect())
}

/// A command whose body has what goes with it over the WebSocket.
fn command(name: &'static str) -> MethodRouter<Arc<AppState>> {
    post(async move |State(state): State<Arc<AppState>>, bytes: Bytes| {
        let form = such_as(name, false);
        let asked = asked(name, body(&bytes, &form)?, Map::new(), &form)?;
        done(&state, asked).await
    })
}

async fn set(
    State(state): State<Arc<AppState>>,
    Path(parameter): Path<String>,
    bytes: Bytes,
) -> Result<Response, RequestError> {
    let form = "such as {\"value\": 800}";
    let from_path = Map::from_iter([("parameter".to_owned(), parameter.into())]);
    done(&state, asked("set", body(&bytes, form)?, from_path, form)?).await
}

async fn place(
    State(state): State<Arc<AppState>>,
    Path(object): Path<String>,
    bytes: Bytes,
) -> Result<Response, RequestError> {
    let form = "such as {\"p\": [0, 0, 0.01], \"q\": [0, 0, 0, 1]}";
    let pose = body(&bytes, form)?;
    let from_path =
        Map::from_iter([("object".to_owned(), object.into()), ("pose".to_owned(), pose.into())]);
    done(&state, asked("place", Map::new(), from_path, form)?).await
}

/// The body of a command; an empty one counts as an empty object.
fn body(bytes: &Bytes, form: &str) -> Result<Map<String, Value>, RequestError> {
    let bytes = if bytes.is_empty() { &b"{}"[..] } else { &bytes[..] };
    serde_json::from_slice(bytes)
        .map_err(|error| RequestError::bad(format!("the body will not do: {error}"), form))
}

/// A command: what its body says, and what its address does.
fn asked(
    name: &str,
    mut body: Map<String, Value>,
    mut from_path: Map<String, Value>,
    form: &str,
) -> Result<ClientCommand, RequestError> {
    from_path.insert("do".to_owned(), name.into());
    for (key, value) in from_path {
        if body.insert(key.clone(), value).is_some() {
            return Err(RequestError::bad(
                format!("the body will not do: unknown field `{key}`"),
                form,
            ));
        }
    }
    read(body, "the body will not do: ").map_err(|error| RequestError::bad(error, form))
}

async fn clay(State(state): State<Arc<AppState>>) -> Result<Json<Value>, RequestError> {
    let clay = state.hub.clay()?;
    let is_watched = !state.hub.clients().is_empty();
    let view = clay.fresh_view(is_watched).await?;
    Ok(Json(clay.facts(&view, state.hub.hold.holds())))
}

async fn clay_files(State(state): State<Arc<AppState>>) -> Result<Json<Value>, RequestError> {
    let saved = state.hub.clay()?.saved().clone();
    let shown = |(idx, path): (usize, &PathBuf)| {
        let number = idx + 1;
        json!({
            "number": number,
            "name": download::name_of(path),
            "file": path.to_string_lossy(),
            "bytes": download::length(path),
            "download": format!("/api/v1/clay/files/{number}"),
        })
    };
    let all = state.files.run(move || saved.iter().enumerate().map(shown).collect()).await;
    Ok(Json(all.unwrap_or_else(|| Value::Array(Vec::new()))))
}

async fn clay_file(
    State(state): State<Arc<AppState>>,
    Path(number): Path<usize>,
) -> Result<Response, RequestError> {
    let path =
        number.checked_sub(1).and_then(|idx| state.hub.clay().ok()?.saved().get(idx).cloned());
    let unknown = || {
        RequestError::new(
            StatusCode::NOT_FOUND,
            format!("this run has saved no file {number}"),
            "GET /api/v1/clay/files lists them",
        )
    };
    download::send(&state.files, path.ok_or_else(unknown)?).await
}

/// What is embossed from now on.
async fn clay_image(
    State(state): State<Arc<AppState>>,
    request: Request,
) -> Result<Response, RequestError> {
    uploaded(&state, request, |bytes| image_of(&bytes)).await
}

async fn no_clay_image(State(state): State<Arc<AppState>>) -> Result<Response, RequestError> {
    let without = SculptOrder::Adjust(ToolChange { image: Some(None), ..ToolChange::default() });
    answered(|reply| super::clay::order(&state.hub, |_| Ok(without), reply)).await
}

/// What Booleans work with from now on.
async fn clay_solid(
    State(state): State<Arc<AppState>>,
    asked: Result<Query<SolidAsked>, QueryRejection>,
    request: Request,
) -> Result<Response, RequestError> {
    let Query(asked) = asked.map_err(|refused| {
        RequestError::bad(refused.body_text(), "such as PUT /api/v1/clay/solid?format=stl&units=mm")
    })?;
    uploaded(&state, request, move |bytes| solid_of(&bytes, asked)).await
}

async fn no_clay_solid(State(state): State<Arc<AppState>>) -> Result<Response, RequestError> {
    let without = SculptOrder::Adjust(ToolChange { solid: Some(None), ..ToolChange::default() });
    answered(|reply| super::clay::order(&state.hub, |_| Ok(without), reply)).await
}

/// Lays material by a text of values.
async fn clay_values(
    State(state): State<Arc<AppState>>,
    asked: Result<Query<ValuesAsked>, QueryRejection>,
    request: Request,
) -> Result<Response, RequestError> {
    let Query(asked) = asked.map_err(|refused| {
        RequestError::bad(refused.body_text(), "such as PUT /api/v1/clay/values?within_m=0.001")
    })?;
    uploaded(&state, request, move |bytes| values_of(&bytes, asked)).await
}

/// Takes the file of a client, reads it on a thread that may take its time, and gives it to the
/// clay.
async fn uploaded(
    state: &Arc<AppState>,
    request: Request,
    read: impl FnOnce(Bytes) -> Result<SculptOrder, RequestError> + Send + 'static,
) -> Result<Response, RequestError> {
    // Before the work: a scene without clay says so.
    state.hub.clay()?;
    // One file after the other, from its first byte on, also where a client has gone away
    // meanwhile: each may take seconds, and as much memory as many of its size.
    let turn = state.upload_turn.clone().try_acquire_owned();
    let turn =
        turn.map_err(|_| RequestError::too_many("another file for the clay is being read"))?;
    let bytes = match whole_body(request, UPLOAD).await? {
        Ok(bytes) => bytes,
        Err(refused) => return Ok(refused.into_response()),
    };
    let read = move || {
        let order = read(bytes);
        give_back_memory();
        drop(turn);
        order
    };
    let order = state.uploads.run(read).await;
    let order = order.unwrap_or_else(|| {
        Err(RequestError::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "reading the file failed inside hapticd",
            "the log has more",
        ))
    })?;
    answered(|reply| super::clay::order(&state.hub, |_| Ok(order), reply)).await
}

/// The body of a request, where all of it comes within this time. What the framework refuses is
/// put into our words by [`in_our_words`].
async fn whole_body(
    request: Request,
    within: Duration,
) -> Result<Result<Bytes, BytesRejection>, RequestError> {
    tokio::time::timeout(within, Bytes::from_request(request, &())).await.map_err(|_| {
        RequestError::new(
            StatusCode::REQUEST_TIMEOUT,
            format!("the file did not arrive within {} s", within.as_secs()),
            "send it again, over a faster network",
        )
    })
}

/// Beside it there may be a token.
#[derive(Deserialize)]
struct SinceAsked {
    #[serde(default)]
    since: u64,
}

async fn clay_points(
    State(state): State<Arc<AppState>>,
    since: Result<Query<SinceAsked>, QueryRejection>,
) -> Result<Response, RequestError> {
    let Query(SinceAsked { since }) = since.map_err(|refused| {
        RequestError::bad(refused.body_text(), "`since` is the version that you have")
    })?;
    let clay = state.hub.clay()?;
    let is_watched = !state.hub.clients().is_empty();
    let view = clay.fresh_view(is_watched).await?;
    // A version of another run may be larger than all of this one.
    if view.version == since {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let made = clay.splats.get(&state.shapes, view).await;
    let (version, bytes) = made.ok_or_else(|| {
        RequestError::unavailable("the samples could not be made ready", "ask again")
    })?;
    // The newest that there are, while newer ones would be too soon.
    if version == since {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    Ok(([(header::CONTENT_TYPE, BYTES)], bytes).into_response())
}

/// Does it, and says that it is done, or that it goes on.
async fn done(state: &Arc<AppState>, asked: ClientCommand) -> Result<Response, RequestError> {
    answered(|reply| perform(&state.hub, &state.files, None, asked, reply)).await
}

async fn answered(ask: impl FnOnce(Reply)) -> Result<Response, RequestError> {
    let (sender, reported) = oneshot::channel();
    ask(Box::new(move |result| drop(sender.send(result))));
    match tokio::time::timeout(PATIENCE, reported).await {
        Ok(Ok(Ok(done))) => {
            let mut answer = json!({ "ok": true });
            done.tell(&mut answer);
            Ok(Json(answer).into_response())
        }
        Ok(Ok(Err(problem))) => Err(problem),
        Ok(Err(_)) => Err(RequestError::conflict("the run cannot do this any more", "")),
        Err(_) => {
            Ok((StatusCode::ACCEPTED, Json(json!({ "ok": true, "goes_on": true }))).into_response())
        }
    }
}

#[cfg(test)]
mod tests {
    use axum::body::Body;
    use futures_util::stream;

    use super::*;

    #[test]
    fn a_body_that_does_not_arrive_is_not_waited_for() {
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_time().build().expect("a runtime");
        let body = Body::from_stream(stream::pending::<std::io::Result<Bytes>>());
        let asked = whole_body(Request::new(body), Duration::from_millis(1));
        let refused = runtime.block_on(asked).expect_err("it never comes");
        assert_eq!(refused.status, StatusCode::REQUEST_TIMEOUT);
        let whole = whole_body(Request::new(Body::from("all")), UPLOAD);
        let whole = runtime.block_on(whole).expect("in time").expect("short enough");
        assert_eq!(whole, "all");
    }
}
