// From two meshes to a wrench.
//
//   gcc -std=c11 query.c $(pkg-config --cflags --libs vps) -o query && ./query [BLOCK.stl BALL.stl, in millimetres]
#include <stdio.h>
#include <stdlib.h>

#include <vps.h>

static void check(vps_status status) {
  if (status != VPS_OK) {
    fprintf(stderr, "vps: %s\n", vps_last_error());
    exit(1);
  }
}

int main(int argc, char **argv) {
  vps_mesh *block = NULL, *ball = NULL;
  if (argc == 3) {
    check(vps_mesh_load(argv[1], 1e-3, &block));
    check(vps_mesh_load(argv[2], 1e-3, &ball));
  } else {
    check(vps_mesh_shape(VPS_BOX, (double[]){40e-3, 40e-3, 40e-3}, 1e-5, &block));
    check(vps_mesh_shape(VPS_SPHERE, (double[]){10e-3, 0, 0}, 1e-5, &ball));
  }
  const vps_options options = vps_options_default(0.5e-3);
  vps_voxmap *voxmap = NULL;
  vps_shell *shell = NULL;
  vps_query *query = NULL;
  check(vps_voxmap_bake(block, &options, NULL, NULL, &voxmap));
  check(vps_shell_bake(ball, &options, NULL, NULL, &shell));
  check(vps_query_new(voxmap, shell, 1000.0, &query));

  const vps_pose pose = {{0, 0, 29.75e-3}, {0, 0, 0, 1}};
  vps_wrench felt;
  check(vps_query_wrench(query, &pose, &felt));
  printf("force %g %g %g N, torque %g %g %g N m, %g m deep, %zu points\n", felt.force_n[0], felt.force_n[1], felt.force_n[2],
         felt.torque_nm[0], felt.torque_nm[1], felt.torque_nm[2], felt.penetration_m, felt.n_contacts);

  vps_query_free(query);
  vps_shell_free(shell);
  vps_voxmap_free(voxmap);
  vps_mesh_free(ball);
  vps_mesh_free(block);
  return 0;
}
