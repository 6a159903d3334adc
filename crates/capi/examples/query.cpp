// From two meshes to a wrench.
//
//   g++ -std=c++17 query.cpp $(pkg-config --cflags --libs vps) -o query && ./query
#include <cstdio>

#include <vps.hpp>

int main() try {
  const auto block = vps::Mesh::shape(VPS_BOX, {40e-3, 40e-3, 40e-3}, 1e-5);
  const auto ball = vps::Mesh::shape(VPS_SPHERE, {10e-3}, 1e-5);
  const auto options = vps::options(0.5e-3);
  const vps::ContactQuery query(vps::Voxmap::bake(block, options), vps::PointShell::bake(ball, options), 1000.0);
  const vps::Wrench felt = query.wrench({{0, 0, 29.75e-3}, {0, 0, 0, 1}});
  std::printf("force %g %g %g N, %g m deep, %zu points\n", felt.force_n[0], felt.force_n[1], felt.force_n[2], felt.penetration_m,
              felt.n_contacts);
} catch (const std::exception &error) {
  std::fprintf(stderr, "vps: %s\n", error.what());
  return 1;
}
