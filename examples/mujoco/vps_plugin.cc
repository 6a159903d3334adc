// MuJoCo plug-in `hapticd.vps`: the contact wrench between two mesh geoms, by a voxmap of one and a pointshell of the other.
//
// Data in: the meshes of the compiled model, in the frames of their geoms, and where the geoms are. Data out: a sensor of eight numbers (README.md), and
// of an instance that a body names the same wrench as a passive force on both bodies. SI units, world axes.
//
// Both meshes are baked when an mjData is made; instances of the same meshes and settings share what was baked. A step allocates nothing.

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include <mujoco/mujoco.h>
#include <vps.h>

namespace {

constexpr const char* kAttributes[] = {"touched", "touching", "voxel_size", "point_spacing", "stiffness", "dissipation", "friction"};
// Baked pairs that stay in memory while no mjData uses them: compiling a model makes one mjData and frees it before the user makes theirs.
constexpr std::size_t kKept = 4;
constexpr int kSensorData = 8;

template <auto free>
struct Free {
  template <class T>
  void operator()(T* handle) const {
    free(handle);
  }
};
using Mesh = std::unique_ptr<vps_mesh, Free<vps_mesh_free>>;
using Voxmap = std::unique_ptr<vps_voxmap, Free<vps_voxmap_free>>;
using Shell = std::unique_ptr<vps_shell, Free<vps_shell_free>>;

// What does not change while a simulation runs.
struct Pair {
  std::unique_ptr<vps_query, Free<vps_query_free>> query;
  std::size_t n_points = 0;
};

struct Instance {
  std::shared_ptr<const Pair> pair;
  int touched = 0, touching = 0;  // geoms
  double dissipation_s_per_m = 0, friction = 0;
  bool has_force = false, has_warned = false;
  std::size_t n_contacts_checked = 0;
  std::vector<vps_contact> contacts;  // room for all points
};

struct Settings {
  int touched = 0, touching = 0;
  double voxel_size_m = 0, point_spacing_m = 0, stiffness_n_per_m = 0, dissipation_s_per_m = 0, friction = 0;
};

bool fail(const std::string& what) {
  mju_warning("hapticd.vps: %s", what.c_str());
  return false;
}

bool geom(const mjModel* m, int instance, const char* key, int* out) {
  const char* name = mj_getPluginConfig(m, instance, key);
  *out = mj_name2id(m, mjOBJ_GEOM, name ? name : "");
  if (*out < 0) return fail(std::string(key) + " = \"" + (name ? name : "") + "\" names no geom");
  if (m->geom_dataid[*out] < 0 || m->geom_type[*out] != mjGEOM_MESH) return fail(std::string(key) + " = \"" + name + "\" is no geom of type mesh");
  return true;
}

// A number of the configuration; fallback where the model gives none.
bool number(const mjModel* m, int instance, const char* key, double fallback, double* out) {
  const char* text = mj_getPluginConfig(m, instance, key);
  if (!text || !*text) {
    *out = fallback;
    return true;
  }
  char* end = nullptr;
  *out = std::strtod(text, &end);
  if (*end || !std::isfinite(*out) || *out < 0) return fail(std::string(key) + " = \"" + text + "\": give a number, 0 or greater");
  return true;
}

bool settings(const mjModel* m, int instance, Settings* out) {
  return geom(m, instance, "touched", &out->touched) && geom(m, instance, "touching", &out->touching) &&
         number(m, instance, "voxel_size", 0, &out->voxel_size_m) &&
         number(m, instance, "point_spacing", 2 * out->voxel_size_m, &out->point_spacing_m) &&
         number(m, instance, "stiffness", 1000, &out->stiffness_n_per_m) &&
         number(m, instance, "dissipation", 0, &out->dissipation_s_per_m) && number(m, instance, "friction", 0, &out->friction);
}

// Vertices and faces of a geom's mesh, in the frame of the geom.
struct Arrays {
  const float* vertices;
  const int* faces;
  std::size_t n_vertices, n_faces;

  Arrays(const mjModel* m, int geom) {
    const int mesh = m->geom_dataid[geom];
    vertices = m->mesh_vert + 3 * m->mesh_vertadr[mesh];
    faces = m->mesh_face + 3 * m->mesh_faceadr[mesh];
    n_vertices = m->mesh_vertnum[mesh];
    n_faces = m->mesh_facenum[mesh];
  }

  std::string bytes() const {
    std::string bytes(reinterpret_cast<const char*>(vertices), 3 * n_vertices * sizeof(float));
    return bytes.append(reinterpret_cast<const char*>(faces), 3 * n_faces * sizeof(int));
  }

  vps_status load(Mesh* out) const {
    std::vector<uint32_t> triangles(faces, faces + 3 * n_faces);
    vps_mesh* mesh = nullptr;
    const vps_status status = vps_mesh_from_f32(vertices, n_vertices, triangles.data(), n_faces, &mesh);
    out->reset(mesh);
    return status;
  }
};

std::shared_ptr<const Pair> bake(const Arrays& touched, const Arrays& touching, const Settings& settings) {
  Mesh mesh;
  vps_voxmap* voxmap = nullptr;
  vps_shell* shell = nullptr;
  vps_query* query = nullptr;
  vps_shell_info info{};
  const vps_options voxels = vps_options_default(settings.voxel_size_m), points = vps_options_default(settings.point_spacing_m);
  auto pair = std::make_shared<Pair>();
  if (touched.load(&mesh) != VPS_OK || vps_voxmap_bake(mesh.get(), &voxels, nullptr, nullptr, &voxmap) != VPS_OK) return nullptr;
  const Voxmap owned_voxmap(voxmap);
  if (touching.load(&mesh) != VPS_OK || vps_shell_bake(mesh.get(), &points, nullptr, nullptr, &shell) != VPS_OK) return nullptr;
  const Shell owned_shell(shell);
  if (vps_shell_describe(shell, &info) != VPS_OK || vps_query_new(voxmap, shell, settings.stiffness_n_per_m, &query) != VPS_OK) return nullptr;
  pair->query.reset(query);
  pair->n_points = info.n_points;
  return pair;
}

// The baked pair of these meshes and settings, made now or before.
std::shared_ptr<const Pair> pair(const mjModel* m, const Settings& settings) {
  static std::mutex mutex;
  static std::deque<std::pair<std::string, std::shared_ptr<const Pair>>> kept;
  const Arrays touched(m, settings.touched), touching(m, settings.touching);
  const double numbers[] = {settings.voxel_size_m, settings.point_spacing_m, settings.stiffness_n_per_m};
  std::string key = touched.bytes() + touching.bytes();
  key.append(reinterpret_cast<const char*>(numbers), sizeof(numbers));
  const std::lock_guard<std::mutex> lock(mutex);
  for (const auto& [other, pair] : kept) {
    if (other == key) return pair;
  }
  auto baked = bake(touched, touching, settings);
  if (baked) {
    kept.emplace_front(std::move(key), baked);
    if (kept.size() > kKept) kept.pop_back();
  }
  return baked;
}

int init(const mjModel* m, mjData* d, int instance) {
  Settings asked;
  if (!settings(m, instance, &asked)) return -1;
  auto baked = pair(m, asked);
  if (!baked) {
    fail(vps_last_error());
    return -1;
  }
  auto made = std::make_unique<Instance>();
  made->touched = asked.touched;
  made->touching = asked.touching;
  made->dissipation_s_per_m = asked.dissipation_s_per_m;
  made->friction = asked.friction;
  made->has_force = std::find(m->body_plugin, m->body_plugin + m->nbody, instance) != m->body_plugin + m->nbody;
  made->contacts.resize(asked.dissipation_s_per_m > 0 || asked.friction > 0 ? baked->n_points : 0);
  made->pair = std::move(baked);
  d->plugin_data[instance] = reinterpret_cast<uintptr_t>(made.release());
  return 0;
}

void destroy(mjData* d, int instance) {
  delete reinterpret_cast<Instance*>(d->plugin_data[instance]);
  d->plugin_data[instance] = 0;
}

// What an instance holds follows from the model, which both have: only a new mjData has none.
void copy(mjData* dest, const mjModel*, const mjData* src, int instance) {
  if (!dest->plugin_data[instance]) {
    dest->plugin_data[instance] = reinterpret_cast<uintptr_t>(new Instance(*reinterpret_cast<Instance*>(src->plugin_data[instance])));
  }
}

// How much faster a force moves the parts apart or along each other, 1/kg; 0 of two that stand.
double per_mass(const mjModel* m, const Instance& it) {
  double sum = 0;
  for (const int geom : {it.touched, it.touching}) {
    const int body = m->body_weldid[m->geom_bodyid[geom]];
    if (m->body_dofnum[body] && m->body_subtreemass[body] > 0) sum += 1 / m->body_subtreemass[body];
  }
  return sum;
}

// Where the touching geom is in the frame of the touched one.
vps_pose pose_of(const mjData* d, const Instance& it) {
  const mjtNum* axes = d->geom_xmat + 9 * it.touched;
  mjtNum offset[3], position[3], to_map[4], of_shell[4], rotation[4];
  mju_sub3(offset, d->geom_xpos + 3 * it.touching, d->geom_xpos + 3 * it.touched);
  mju_mulMatTVec3(position, axes, offset);
  mju_mat2Quat(to_map, axes);
  mju_negQuat(to_map, to_map);
  mju_mat2Quat(of_shell, d->geom_xmat + 9 * it.touching);
  mju_mulQuat(rotation, to_map, of_shell);
  mju_normalize4(rotation);
  return {{position[0], position[1], position[2]}, {rotation[1], rotation[2], rotation[3], rotation[0]}};
}

// The wrench on the touching geom about its own frame's origin, world axes; all 0 where the pose is none.
vps_wrench ask(const mjModel* m, const mjData* d, Instance* it) {
  const mjtNum* axes = d->geom_xmat + 9 * it->touched;
  const vps_pose pose = pose_of(d, *it);
  vps_wrench found{};
  if (it->contacts.empty()) {
    if (vps_query_wrench(it->pair->query.get(), &pose, &found) != VPS_OK) return {};
  } else {
    if (vps_query_contacts(it->pair->query.get(), &pose, it->contacts.data(), it->contacts.size(), &found) != VPS_OK) return {};
    // Hunt and Crossley: a contact that goes deeper pushes harder, one that leaves less, and none pulls. It goes deeper against the gradient of the distance.
    mjtNum of_map[6], of_part[6];
    mj_objectVelocity(m, d, mjOBJ_GEOM, it->touched, of_map, 0);
    mj_objectVelocity(m, d, mjOBJ_GEOM, it->touching, of_part, 0);
    // Motion of the touching part as the touched one sees it, in axes of the latter, at the origin of the former.
    mjtNum offset[3], spin[3], linear[3], carried[3], turned_spin[3], turned_linear[3];
    mju_sub3(offset, d->geom_xpos + 3 * it->touching, d->geom_xpos + 3 * it->touched);
    mju_sub3(spin, of_part, of_map);
    mju_cross(carried, of_map, offset);
    for (int k = 0; k < 3; k++) linear[k] = of_part[3 + k] - of_map[3 + k] - carried[k];
    mju_mulMatTVec3(turned_spin, axes, spin);
    mju_mulMatTVec3(turned_linear, axes, linear);
    mju_zero3(found.force_n);
    mju_zero3(found.torque_nm);
    const std::size_t n = std::min(found.n_contacts, it->contacts.size());
    const auto velocity_of = [&](const vps_contact& contact, mjtNum* arm, mjtNum* velocity) {
      mju_sub3(arm, contact.position_m, pose.position_m);
      mju_cross(velocity, turned_spin, arm);
      mju_addTo3(velocity, turned_linear);
    };
    mjtNum arm[3], velocity[3], sliding[3], torque[3];
    double pressing_n = 0;
    for (std::size_t i = 0; i < n; i++) {
      vps_contact& contact = it->contacts[i];
      velocity_of(contact, arm, velocity);
      const mjtNum deeper = -mju_dot3(velocity, contact.gradient);
      mju_scl3(contact.force_n, contact.force_n, std::max(0.0, 1.0 + it->dissipation_s_per_m * deeper));
      pressing_n += mju_norm3(contact.force_n);
    }
    // Friction is Coulomb's above this speed and in proportion to speed below it: a step then takes half of the speed from parts that do not turn.
    const double slip_speed_m_per_s = 2 * it->friction * pressing_n * m->opt.timestep * per_mass(m, *it);
    for (std::size_t i = 0; i < n; i++) {
      mjtNum* force = it->contacts[i].force_n;
      const vps_contact& contact = it->contacts[i];
      velocity_of(contact, arm, velocity);
      mju_addScl3(sliding, velocity, contact.normal, -mju_dot3(velocity, contact.normal));
      mju_addToScl3(force, sliding, -it->friction * mju_norm3(force) / std::max({mju_norm3(sliding), slip_speed_m_per_s, mjMINVAL}));
      mju_cross(torque, arm, force);
      mju_addTo3(found.force_n, force);
      mju_addTo3(found.torque_nm, torque);
    }
  }
  mjtNum turned[3];
  mju_mulMatVec3(turned, axes, found.force_n);
  mju_copy3(found.force_n, turned);
  mju_mulMatVec3(turned, axes, found.torque_nm);
  mju_copy3(found.torque_nm, turned);
  return found;
}

// Says once where the force, which is explicit in time, has a step that is too long for it: what then moves apart looks like a fault of the contact.
void warn_of_long_step(const mjModel* m, const mjData* d, Instance* it, std::size_t n_contacts) {
  // Seldom: more points than ever before make it stiffer.
  if (it->has_warned || n_contacts <= it->n_contacts_checked) return;
  it->n_contacts_checked = n_contacts + n_contacts / 4;
  const vps_pose pose = pose_of(d, *it);
  vps_stiffness found{};
  if (vps_query_stiffness(it->pair->query.get(), &pose, &found) != VPS_OK) return;
  // No less than in any direction.
  double stiffness_n_per_m = 0;
  for (int k = 0; k < 3; k++) stiffness_n_per_m = std::max(stiffness_n_per_m, std::abs(found.rows[k][0]) + std::abs(found.rows[k][1]) + std::abs(found.rows[k][2]));
  const double longest_s = 2 / std::sqrt(stiffness_n_per_m * per_mass(m, *it));
  if (!(m->opt.timestep > longest_s)) return;
  it->has_warned = true;
  mju_warning("hapticd.vps: a time step of %g s is too long for a contact of %.3g N/m: take one below %.2g s, or a smaller stiffness", m->opt.timestep,
              stiffness_n_per_m, longest_s);
}

void compute(const mjModel* m, mjData* d, int instance, int capability) {
  auto* it = reinterpret_cast<Instance*>(d->plugin_data[instance]);
  if (capability == mjPLUGIN_SENSOR) {
    const vps_wrench found = ask(m, d, it);
    for (int sensor = 0; sensor < m->nsensor; sensor++) {
      if (m->sensor_type[sensor] != mjSENS_PLUGIN || m->sensor_plugin[sensor] != instance) continue;
      mjtNum* out = d->sensordata + m->sensor_adr[sensor];
      mju_copy3(out, found.force_n);
      mju_copy3(out + 3, found.torque_nm);
      out[6] = found.penetration_m;
      out[7] = found.clearance_m;
    }
  } else if (it->has_force) {
    const vps_wrench found = ask(m, d, it);
    warn_of_long_step(m, d, it, found.n_contacts);
    const mjtNum* point = d->geom_xpos + 3 * it->touching;
    mjtNum force[3], torque[3];
    mj_applyFT(m, d, found.force_n, found.torque_nm, point, m->geom_bodyid[it->touching], d->qfrc_passive);
    mju_scl3(force, found.force_n, -1);
    mju_scl3(torque, found.torque_nm, -1);
    mj_applyFT(m, d, force, torque, point, m->geom_bodyid[it->touched], d->qfrc_passive);
  }
}

}  // namespace

mjPLUGIN_LIB_INIT(hapticd_vps) {
  mjpPlugin plugin;
  mjp_defaultPlugin(&plugin);
  plugin.name = "hapticd.vps";
  plugin.nattribute = sizeof(kAttributes) / sizeof(*kAttributes);
  plugin.attributes = kAttributes;
  plugin.capabilityflags = mjPLUGIN_SENSOR | mjPLUGIN_PASSIVE;
  // Dissipation reads velocities.
  plugin.needstage = mjSTAGE_VEL;
  plugin.nstate = [](const mjModel*, int) { return 0; };
  plugin.nsensordata = [](const mjModel*, int, int) { return kSensorData; };
  plugin.init = init;
  plugin.destroy = destroy;
  plugin.copy = copy;
  plugin.reset = [](const mjModel*, mjtNum*, void*, int) {};
  plugin.compute = compute;
  mjp_registerPlugin(&plugin);
}
