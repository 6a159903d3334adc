// vps.hpp: handles move and end, callbacks may throw, errors carry their text.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include <vps.hpp>

#define EXPECT(condition)                                                  \
  do {                                                                     \
    if (!(condition)) {                                                    \
      std::fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition); \
      std::exit(1);                                                        \
    }                                                                      \
  } while (0)

template <typename Call>
std::string refused(vps_status status, Call call) {
  try {
    call();
  } catch (const vps::Error& error) {
    EXPECT(error.status() == status);
    return error.what();
  }
  EXPECT(!"it should throw");
  return {};
}

int main(int argc, char** argv) {
  EXPECT(argc == 2);
  const std::string folder = argv[1];
  const std::vector<float> vertices{0, 0, 0, 0.03f, 0, 0, 0, 0.03f, 0, 0, 0, 0.03f};
  const std::vector<std::uint32_t> faces{0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3};
  const auto part = vps::Mesh::from_arrays(vertices, faces);
  EXPECT(part.warnings().empty() && std::abs(part.mass().volume_m3 - 4.5e-6) < 1e-9);
  const std::vector<double> short_of_one{0, 0, 0, 1};
  EXPECT(refused(VPS_ERROR_ARGUMENT, [&] { vps::Mesh::from_arrays(short_of_one, faces); }) == "vertices_m has 4 elements: give three of each");
  EXPECT(refused(VPS_ERROR_MESH, [] { vps::Mesh::load("none.obj", 1.0); }).find("none.obj: no such file") == 0);

  const auto options = vps::options(1e-3);
  int stages = 0;
  auto voxmap = vps::Voxmap::bake(part, options, [&](vps_stage) { return ++stages > 0; });
  EXPECT(stages == 6);
  refused(VPS_ERROR_CANCELLED, [&] { vps::PointShell::bake(part, options, [](vps_stage stage) { return stage != VPS_STAGE_FILL; }); });
  try {
    vps::Voxmap::bake(part, options, [](vps_stage) -> bool { throw std::string("thrown by the callback"); });
    EXPECT(!"it should throw");
  } catch (const std::string& thrown) {
    EXPECT(thrown == "thrown by the callback");
  }

  voxmap.save(folder + "/part");
  auto moved = std::move(voxmap);
  moved = vps::Voxmap::load(folder + "/part");
  EXPECT(refused(VPS_ERROR_FILE, [&] { vps::PointShell::load(folder + "/part"); }).find("holds no pointshell") != std::string::npos);
  EXPECT(moved.describe().band_m > 7e-3 && moved.distance({0.005, 0.005, -0.002}).distance_m > 1.9e-3);

  // The pair rests on its common face, half a millimetre deep.
  const vps::ContactQuery query(moved, vps::PointShell::bake(part, options), 100.0);
  const std::vector<vps::Pose> poses{{{0, 0, -0.0295}, {0, 0, 0, 1}}, {{0, 0, 1}, {0, 0, 0, 1}}};
  std::vector<vps::Wrench> felt(2);
  query.wrenches(poses, felt);
  EXPECT(felt[0].n_contacts > 0 && felt[0].force_n[2] < 0 && felt[1].n_contacts == 0);
  EXPECT(query.contacts(poses[0]).size() == felt[0].n_contacts && query.wrench(poses[0]).force_n[2] == felt[0].force_n[2]);
  EXPECT(refused(VPS_ERROR_ARGUMENT, [&] { query.wrenches(poses, vps::View<vps::Wrench>(felt.data(), 1)); }).find("fewer") != std::string::npos);
  const vps::Stiffness stiff = query.stiffness(poses[0]);
  EXPECT(stiff.rows[2][2] > 0 && stiff.rows[0][4] == stiff.rows[4][0] && query.stiffness(poses[1]).rows[2][2] == 0);
  EXPECT(refused(VPS_ERROR_ARGUMENT, [&] { query.wrench({{0, 0, 0}, {1, 1, 0, 0}}); }).find("pose 0: rotation") == 0);

  const auto patches = query.patches(poses[0]);
  double force_n = 0;
  for (const auto& patch : patches) force_n += patch.force_n[2];
  EXPECT(!patches.empty() && std::abs(force_n - felt[0].force_n[2]) < 1e-4 * std::abs(force_n) && query.patches(poses[1]).empty());
  const vps::Pose above{{0, 0, -0.032}, {0, 0, 0, 1}};
  const vps::Nearest nearest = query.nearest(above);
  EXPECT(nearest.is_known && nearest.distance_m == query.wrench(above).clearance_m && std::abs(nearest.distance_m - 0.002) < 1e-4);
  EXPECT(std::abs(nearest.on_shell_m[2] - nearest.on_part_m[2]) < 0.0021 && !query.nearest(poses[0]).is_known);
  const vps::Impact impact = query.first_contact(above, poses[0], 1e-6);
  // A corner comes down on a corner, which interpolation has a little lower.
  EXPECT(impact.touches && impact.share > 0.8 && impact.share < 0.84 && query.wrench(impact.pose).n_contacts > 0);
  EXPECT(!query.first_contact(above, above, 1e-6).touches);
  // The part twice at one place presses twice as hard.
  const std::vector<std::pair<const vps::Voxmap*, vps::Pose>> parts{{&moved, {{0, 0, 0}, {0, 0, 0, 1}}}, {&moved, {{0, 0, 0}, {0, 0, 0, 1}}}};
  const vps::ContactQuery twice(parts, vps::PointShell::bake(part, options), 100.0);
  EXPECT(std::abs(twice.wrench(poses[0]).force_n[2] - 2 * felt[0].force_n[2]) < 1e-6 && twice.contacts(poses[0]).back().part == 1);
  // A part in its own like: half of each way is what one way has, where both are alike.
  const auto points = vps::PointShell::bake(part, options);
  auto both = vps::ContactQuery::both_ways(moved, points, moved, points, 100.0);
  EXPECT(both.wrench(poses[0]).n_contacts > felt[0].n_contacts && both.wrench(poses[0]).force_n[2] < 0);
  EXPECT(both.error_m() > 0.1e-3 && both.error_m() == query.error_m());
  both.set_field(VPS_FIELD_LAYERS);
  EXPECT(refused(VPS_ERROR_ARGUMENT, [&] { both.set_field(VPS_FIELD_SURFACE_POINT); }).find("bake them for this field") != std::string::npos);
  std::puts("wrapper: ok");
}
