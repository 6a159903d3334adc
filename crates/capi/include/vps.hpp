// vps.h for C++17: handles that free themselves, arrays as views, errors as exceptions with their text.
#ifndef VPS_HPP
#define VPS_HPP

#include <array>
#include <exception>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "vps.h"

namespace vps {

using Vector = std::array<double, 3>;
using Pose = vps_pose;
using Wrench = vps_wrench;
using Contact = vps_contact;
using Mass = vps_mass;
using Solid = vps_solid;
using Accuracy = vps_accuracy;
using Options = vps_options;
using Stiffness = vps_stiffness;
using Nearest = vps_nearest;
using Patch = vps_patch;
using Impact = vps_impact;

/// Elements that the caller owns, of a vector, an array or a std::span; they are only read where T is const.
template <typename T>
class View {
 public:
  View(T* data, std::size_t size) noexcept : data_(data), size_(size) {}
  template <std::size_t N>
  View(T (&elements)[N]) noexcept : View(elements, N) {}
  template <typename Elements, typename Pointer = decltype(std::declval<Elements&>().data()),
            typename = std::enable_if_t<std::is_convertible_v<std::remove_pointer_t<Pointer> (*)[], T (*)[]>>>
  View(Elements&& elements) noexcept : View(elements.data(), elements.size()) {}
  T* data() const noexcept { return data_; }
  std::size_t size() const noexcept { return size_; }

 private:
  T* data_;
  std::size_t size_;
};

/// A call that failed; what() says what is wrong, where, and what to do.
class Error : public std::runtime_error {
 public:
  Error(vps_status status, const char* text) : std::runtime_error(text), status_(status) {}
  vps_status status() const noexcept { return status_; }

 private:
  vps_status status_;
};

/// Hears of each stage of a bake before it begins, and answers whether to go on. An exception ends the bake as well, and reaches its caller.
using Progress = std::function<bool(vps_stage)>;

namespace detail {

inline void check(vps_status status) {
  if (status != VPS_OK) throw Error(status, vps_last_error());
}

/// Throws where the library is not the one that this header is of.
inline void check_abi() {
  if (vps_abi_version() != VPS_ABI_VERSION) {
    throw std::runtime_error("libvps has ABI " + std::to_string(vps_abi_version()) + ", and the program was compiled for " +
                             std::to_string(VPS_ABI_VERSION) + ": compile it with the header of the library");
  }
}

template <typename T, void (*Free)(T*)>
struct Deleter {
  void operator()(T* handle) const noexcept { Free(handle); }
};

template <typename T, void (*Free)(T*)>
using Handle = std::unique_ptr<T, Deleter<T, Free>>;

template <typename T, typename Make>
T* make(Make call) {
  check_abi();
  T* made = nullptr;
  check(call(&made));
  return made;
}

/// A callback and what it threw, which must not cross the library.
struct Watch {
  const Progress& progress;
  std::exception_ptr thrown;

  static int hear(vps_stage stage, void* user) noexcept {
    auto& watch = *static_cast<Watch*>(user);
    try {
      return watch.progress(stage) ? 0 : 1;
    } catch (...) {
      watch.thrown = std::current_exception();
      return 1;
    }
  }
};

template <typename T, typename Bake>
T* bake(const Progress& progress, Bake call) {
  check_abi();
  Watch watch{progress, nullptr};
  T* made = nullptr;
  const vps_status status = call(progress ? &Watch::hear : nullptr, &watch, &made);
  if (watch.thrown) std::rethrow_exception(watch.thrown);
  check(status);
  return made;
}

/// Number of triples in an array of x, y, z.
template <typename T>
std::size_t triples(View<T> values, const char* name) {
  if (values.size() % 3 != 0) {
    throw Error(VPS_ERROR_ARGUMENT, (std::string(name) + " has " + std::to_string(values.size()) + " elements: give three of each").c_str());
  }
  return values.size() / 3;
}

}  // namespace detail

/// Voxels of this edge, m, and for the rest what suits most parts.
inline Options options(double voxel_size_m) { return vps_options_default(voxel_size_m); }

/// Triangles of a part. Units and frames are those of vps.h.
class Mesh {
 public:
  /// An OBJ, STL, PLY, glTF or 3MF file whose numbers count metres_per_unit: 0.001 for millimetres.
  static Mesh load(const std::string& path, double metres_per_unit) {
    return Mesh(detail::make<vps_mesh>([&](vps_mesh** out) { return vps_mesh_load(path.c_str(), metres_per_unit, out); }));
  }
  /// Vertices [n][3], m, and triangles [m][3], numbers of vertices from 0.
  static Mesh from_arrays(View<const double> vertices_m, View<const std::uint32_t> triangles) {
    return from(vertices_m, triangles, vps_mesh_from_f64);
  }
  static Mesh from_arrays(View<const float> vertices_m, View<const std::uint32_t> triangles) {
    return from(vertices_m, triangles, vps_mesh_from_f32);
  }
  /// A shape around the origin; sizes as vps_shape says.
  static Mesh shape(vps_shape shape, Vector sizes_m, double tolerance_m) {
    return Mesh(detail::make<vps_mesh>([&](vps_mesh** out) { return vps_mesh_shape(shape, sizes_m.data(), tolerance_m, out); }));
  }

  Mass mass() const {
    Mass mass;
    detail::check(vps_mesh_mass(handle_.get(), &mass));
    return mass;
  }
  /// What the triangles were taken for.
  Solid solid() const {
    Solid solid;
    detail::check(vps_mesh_solid(handle_.get(), &solid));
    return solid;
  }
  /// Lowest and highest corner of the box around the triangles, m.
  std::pair<Vector, Vector> bounds() const {
    std::pair<Vector, Vector> corners;
    detail::check(vps_mesh_bounds(handle_.get(), corners.first.data(), corners.second.data()));
    return corners;
  }
  /// A line for each thing that a user should look at.
  std::string warnings() const { return vps_mesh_warnings(handle_.get()); }
  const vps_mesh* get() const noexcept { return handle_.get(); }

 private:
  explicit Mesh(vps_mesh* handle) : handle_(handle) {}

  template <typename T, typename From>
  static Mesh from(View<const T> vertices_m, View<const std::uint32_t> triangles, From call) {
    const std::size_t n_vertices = detail::triples(vertices_m, "vertices_m"), n_triangles = detail::triples(triangles, "triangles");
    return Mesh(detail::make<vps_mesh>(
        [&](vps_mesh** out) { return call(vertices_m.data(), n_vertices, triangles.data(), n_triangles, out); }));
  }

  detail::Handle<vps_mesh, vps_mesh_free> handle_;
};

/// A distance, m, and its gradient.
struct Distance {
  double distance_m;
  Vector gradient;
};

/// The part that is touched.
class Voxmap {
 public:
  static Voxmap bake(const Mesh& mesh, const Options& options, const Progress& progress = {}) {
    return Voxmap(detail::bake<vps_voxmap>(progress, [&](vps_progress hear, void* user, vps_voxmap** out) {
      return vps_voxmap_bake(mesh.get(), &options, hear, user, out);
    }));
  }
  static Voxmap load(const std::string& path) {
    return Voxmap(detail::make<vps_voxmap>([&](vps_voxmap** out) { return vps_voxmap_load(path.c_str(), out); }));
  }
  void save(const std::string& path) const { detail::check(vps_voxmap_save(handle_.get(), path.c_str())); }

  /// Greater than 0 outside; never beyond the band on either side.
  Distance distance(Vector point_m) const {
    Distance found;
    detail::check(vps_voxmap_distance(handle_.get(), point_m.data(), &found.distance_m, found.gradient.data()));
    return found;
  }
  vps_voxmap_info describe() const {
    vps_voxmap_info info;
    detail::check(vps_voxmap_describe(handle_.get(), &info));
    return info;
  }
  /// What the bake measured.
  Accuracy accuracy() const {
    Accuracy accuracy;
    detail::check(vps_voxmap_accuracy(handle_.get(), &accuracy));
    return accuracy;
  }
  std::string warnings() const { return vps_voxmap_warnings(handle_.get()); }
  const vps_voxmap* get() const noexcept { return handle_.get(); }

 private:
  explicit Voxmap(vps_voxmap* handle) : handle_(handle) {}
  detail::Handle<vps_voxmap, vps_voxmap_free> handle_;
};

/// The part that touches.
class PointShell {
 public:
  static PointShell bake(const Mesh& mesh, const Options& options, const Progress& progress = {}) {
    return PointShell(detail::bake<vps_shell>(progress, [&](vps_progress hear, void* user, vps_shell** out) {
      return vps_shell_bake(mesh.get(), &options, hear, user, out);
    }));
  }
  static PointShell load(const std::string& path) {
    return PointShell(detail::make<vps_shell>([&](vps_shell** out) { return vps_shell_load(path.c_str(), out); }));
  }
  void save(const std::string& path) const { detail::check(vps_shell_save(handle_.get(), path.c_str())); }

  vps_shell_info describe() const {
    vps_shell_info info;
    detail::check(vps_shell_describe(handle_.get(), &info));
    return info;
  }
  /// What the bake measured.
  Accuracy accuracy() const {
    Accuracy accuracy;
    detail::check(vps_shell_accuracy(handle_.get(), &accuracy));
    return accuracy;
  }
  std::string warnings() const { return vps_shell_warnings(handle_.get()); }
  const vps_shell* get() const noexcept { return handle_.get(); }

 private:
  explicit PointShell(vps_shell* handle) : handle_(handle) {}
  detail::Handle<vps_shell, vps_shell_free> handle_;
};

/// Asks what wrench voxmaps exert on a shell. Any number of threads may ask one query at a time.
class ContactQuery {
 public:
  ContactQuery(const Voxmap& voxmap, const PointShell& shell, double stiffness_n_per_m)
      : handle_(detail::make<vps_query>(
            [&](vps_query** out) { return vps_query_new(voxmap.get(), shell.get(), stiffness_n_per_m, out); })) {}

  /// Several voxmaps, each with its pose in one world.
  ContactQuery(View<const std::pair<const Voxmap*, Pose>> parts, const PointShell& shell, double stiffness_n_per_m)
      : handle_(detail::make<vps_query>([&](vps_query** out) {
          std::vector<const vps_voxmap*> voxmaps;
          std::vector<Pose> poses;
          for (std::size_t n = 0; n < parts.size(); n++) {
            const Voxmap* voxmap = parts.data()[n].first;
            voxmaps.push_back(voxmap ? voxmap->get() : nullptr);
            poses.push_back(parts.data()[n].second);
          }
          return vps_query_new_of_parts(voxmaps.data(), poses.data(), voxmaps.size(), shell.get(), stiffness_n_per_m, out);
        })) {}

  /// Half of the energy of each part's points in the other one, as vps_query_new_both_ways says: the part that stands still, and the one that moves.
  static ContactQuery both_ways(const Voxmap& voxmap, const PointShell& own_shell, const Voxmap& own_voxmap, const PointShell& shell,
                                double stiffness_n_per_m) {
    return ContactQuery(detail::make<vps_query>([&](vps_query** out) {
      return vps_query_new_both_ways(voxmap.get(), own_shell.get(), own_voxmap.get(), shell.get(), stiffness_n_per_m, out);
    }));
  }
  /// How far answers may be off, m, as vps_query_error_m says; NaN where that is not known.
  double error_m() const {
    double error_m;
    detail::check(vps_query_error_m(handle_.get(), &error_m));
    return error_m;
  }
  /// Before threads share it.
  void set_field(vps_field field) { detail::check(vps_query_set_field(handle_.get(), field)); }

  Wrench wrench(const Pose& pose) const {
    Wrench felt;
    detail::check(vps_query_wrench(handle_.get(), &pose, &felt));
    return felt;
  }
  /// Fills as many contacts as there is room for; n_contacts of the answer says how many there are.
  Wrench contacts(const Pose& pose, View<Contact> contacts) const {
    Wrench felt;
    detail::check(vps_query_contacts(handle_.get(), &pose, contacts.data(), contacts.size(), &felt));
    return felt;
  }
  /// All contacts. Allocates.
  std::vector<Contact> contacts(const Pose& pose) const {
    std::vector<Contact> all(wrench(pose).n_contacts);
    contacts(pose, View<Contact>(all));
    return all;
  }
  /// Second derivative of the contact's energy, as vps_query_stiffness says.
  Stiffness stiffness(const Pose& pose) const {
    Stiffness found;
    detail::check(vps_query_stiffness(handle_.get(), &pose, &found));
    return found;
  }
  /// The point of the shell that is nearest to a part; is_known is false in contact and beyond the band.
  Nearest nearest(const Pose& pose) const {
    Nearest found;
    detail::check(vps_query_nearest(handle_.get(), &pose, &found));
    return found;
  }
  /// What touches, in few words, the hardest first. Allocates.
  std::vector<Patch> patches(const Pose& pose) const {
    std::vector<Patch> found(64);
    std::size_t n = 0;
    detail::check(vps_query_patches(handle_.get(), &pose, found.data(), found.size(), &n));
    if (n > found.size()) {
      found.resize(n);
      detail::check(vps_query_patches(handle_.get(), &pose, found.data(), found.size(), &n));
    }
    found.resize(n);
    return found;
  }
  /// Where a motion first touches, as vps_query_first_contact says.
  Impact first_contact(const Pose& from, const Pose& to, double tolerance_m) const {
    Impact found;
    detail::check(vps_query_first_contact(handle_.get(), &from, &to, tolerance_m, &found));
    return found;
  }
  /// As many wrenches as poses, on all processors.
  void wrenches(View<const Pose> poses, View<Wrench> out) const {
    if (out.size() < poses.size()) throw Error(VPS_ERROR_ARGUMENT, "out has fewer elements than poses: give as many");
    detail::check(vps_query_wrenches(handle_.get(), poses.data(), poses.size(), out.data()));
  }
  const vps_query* get() const noexcept { return handle_.get(); }

 private:
  explicit ContactQuery(vps_query* handle) : handle_(handle) {}
  detail::Handle<vps_query, vps_query_free> handle_;
};

}  // namespace vps

#endif  // VPS_HPP
