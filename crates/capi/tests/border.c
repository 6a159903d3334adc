// The whole interface from C: what it gives, what it refuses, and with which words. Ends with 1 at the first thing that is wrong.
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <vps.h>

#define EXPECT(condition)                                                                   \
  do {                                                                                      \
    if (!(condition)) {                                                                     \
      fprintf(stderr, "%s:%d: %s; %s\n", __FILE__, __LINE__, #condition, vps_last_error()); \
      exit(1);                                                                              \
    }                                                                                       \
  } while (0)

// A call that has to fail with this status and a text that has this in it.
#define REFUSED(call, status, words) EXPECT((call) == (status) && strstr(vps_last_error(), (words)) != NULL)

enum { POSES = 500 };

static const double TETRAHEDRON[4][3] = {{0, 0, 0}, {0.03, 0, 0}, {0, 0.03, 0}, {0, 0, 0.03}};
static const uint32_t FACES[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};

static vps_pose poses[POSES];
static vps_wrench alone[POSES];

static int heard;

static int until_layers(vps_stage stage, void *user) {
  static double share = 2;
  EXPECT(vps_stage_share(stage) < 1 && (stage == VPS_STAGE_SURFACE || vps_stage_share(stage) > share));
  share = vps_stage_share(stage);
  ++heard;
  return stage == *(const vps_stage *)user;
}

static void *ask_all(void *query) {
  vps_wrench felt;
  for (int n = 0; n < POSES; ++n) {
    EXPECT(vps_query_wrench(query, &poses[n], &felt) == VPS_OK);
    EXPECT(memcmp(&felt, &alone[n], sizeof felt) == 0);
  }
  return NULL;
}

static void meshes(void) {
  vps_mesh *mesh = (vps_mesh *)1;
  EXPECT(vps_last_error()[0] == 0);
  REFUSED(vps_mesh_load("no such file.stl", 1e-3, &mesh), VPS_ERROR_MESH, "no such file.stl: no such file");
  EXPECT(mesh == NULL);
  REFUSED(vps_mesh_load(NULL, 1e-3, &mesh), VPS_ERROR_ARGUMENT, "path is null");
  REFUSED(vps_mesh_load("part.stl", NAN, &mesh), VPS_ERROR_ARGUMENT, "metres_per_unit is NaN");
  REFUSED(vps_mesh_load("part.stl", 1e-3, NULL), VPS_ERROR_ARGUMENT, "out is null");
  REFUSED(vps_mesh_from_f64(&TETRAHEDRON[0][0], 3, &FACES[0][0], 4, &mesh), VPS_ERROR_MESH, "triangle 1 names vertex 3");
  REFUSED(vps_mesh_from_f64(&TETRAHEDRON[0][0], 4, NULL, 4, &mesh), VPS_ERROR_ARGUMENT, "triangles is null: give 4");
  REFUSED(vps_mesh_from_f64(&TETRAHEDRON[0][0], SIZE_MAX, &FACES[0][0], 4, &mesh), VPS_ERROR_ARGUMENT, "vertices_m has");
  REFUSED(vps_mesh_from_f64(NULL, 0, NULL, 0, &mesh), VPS_ERROR_MESH, "none of the 0 triangles");
  REFUSED(vps_mesh_from_f64((const double *)(((const char *)TETRAHEDRON) + 1), 3, &FACES[0][0], 4, &mesh), VPS_ERROR_ARGUMENT, "aligned");
  REFUSED(vps_mesh_shape(17, (double[]){1, 1, 1}, 1e-3, &mesh), VPS_ERROR_ARGUMENT, "shape is 17");
  REFUSED(vps_mesh_shape(VPS_SPHERE, NULL, 1e-3, &mesh), VPS_ERROR_ARGUMENT, "sizes_m is null");

  float vertices[4][3];
  for (int n = 0; n < 12; ++n) (&vertices[0][0])[n] = (float)(&TETRAHEDRON[0][0])[n];
  size_t n_vertices = 0, n_triangles = 0;
  vps_mass mass;
  EXPECT(vps_mesh_from_f32(&vertices[0][0], 4, &FACES[0][0], 4, &mesh) == VPS_OK);
  EXPECT(vps_mesh_counts(mesh, &n_vertices, &n_triangles) == VPS_OK && n_vertices == 4 && n_triangles == 4);
  EXPECT(vps_mesh_counts(mesh, NULL, NULL) == VPS_OK);
  double low_m[3], high_m[3];
  EXPECT(vps_mesh_bounds(mesh, low_m, high_m) == VPS_OK && low_m[2] == 0 && fabs(high_m[2] - 0.03) < 1e-8);
  REFUSED(vps_mesh_bounds(mesh, low_m, NULL), VPS_ERROR_ARGUMENT, "high_m is null");
  vps_solid solid;
  EXPECT(vps_mesh_solid(mesh, &solid) == VPS_OK && solid.n_pieces == 1 && solid.n_bodies == 1 && solid.n_cavities == 0 && solid.n_open_pieces == 0);
  EXPECT(vps_mesh_mass(mesh, &mass) == VPS_OK && fabs(mass.volume_m3 - 0.03 * 0.03 * 0.03 / 6) < 1e-10);
  EXPECT(vps_mesh_warnings(mesh)[0] == 0 && vps_mesh_warnings(NULL)[0] == 0);
  vps_mesh_free(mesh);
  // Without its last face it is open.
  EXPECT(vps_mesh_from_f64(&TETRAHEDRON[0][0], 4, &FACES[0][0], 3, &mesh) == VPS_OK);
  EXPECT(vps_mesh_warnings(mesh)[0] != 0);
  vps_mesh_free(mesh);
  vps_mesh_free(NULL);
}

static void baked(const vps_mesh *block, vps_voxmap **voxmap, vps_shell **shell, const vps_mesh *ball, const char *folder) {
  vps_options options = vps_options_default(0.0);
  EXPECT(options.layers == 8 && options.inside_test == VPS_INSIDE_AUTO);
  REFUSED(vps_voxmap_bake(block, &options, NULL, NULL, voxmap), VPS_ERROR_ARGUMENT, "voxel_size_m is 0");
  options.voxel_size_m = 1e-8;
  REFUSED(vps_voxmap_bake(block, &options, NULL, NULL, voxmap), VPS_ERROR_GRID, "use a voxel size of at least");
  options.voxel_size_m = 0.5e-3;
  options.inside_test = 9;
  REFUSED(vps_shell_bake(ball, &options, NULL, NULL, shell), VPS_ERROR_ARGUMENT, "inside_test is 9");
  options.inside_test = VPS_INSIDE_AUTO;
  options.points = 2;
  REFUSED(vps_shell_bake(ball, &options, NULL, NULL, shell), VPS_ERROR_ARGUMENT, "points is 2");
  options.points = VPS_POINTS_FACETS;
  options.field = 4;
  REFUSED(vps_voxmap_bake(block, &options, NULL, NULL, voxmap), VPS_ERROR_ARGUMENT, "options->field is 4");
  options.field = VPS_FIELD_TRILINEAR;
  REFUSED(vps_voxmap_bake(NULL, &options, NULL, NULL, voxmap), VPS_ERROR_ARGUMENT, "mesh is null");
  REFUSED(vps_voxmap_bake(block, NULL, NULL, NULL, voxmap), VPS_ERROR_ARGUMENT, "options is null");
  vps_stage last = VPS_STAGE_LAYERS;
  REFUSED(vps_voxmap_bake(block, &options, until_layers, &last, voxmap), VPS_ERROR_CANCELLED, "cancelled");
  EXPECT(heard == 3 && *voxmap == NULL);
  last = VPS_STAGE_LOAD;
  EXPECT(vps_voxmap_bake(block, &options, until_layers, &last, voxmap) == VPS_OK && heard == 9);
  EXPECT(vps_shell_bake(ball, &options, NULL, NULL, shell) == VPS_OK);
  EXPECT(vps_voxmap_warnings(*voxmap)[0] == 0 && vps_shell_warnings(*shell)[0] == 0);
  vps_accuracy accuracy;
  EXPECT(vps_voxmap_accuracy(*voxmap, &accuracy) == VPS_OK && accuracy.sample_error_m < 5e-8 && fabs(accuracy.sharpest_edge_deg - 90) < 1e-3 && isnan(accuracy.unseen_depth_m));
  EXPECT(vps_shell_accuracy(*shell, &accuracy) == VPS_OK && accuracy.unseen_depth_m < 0.5e-3 && isnan(accuracy.sample_error_m));
  REFUSED(vps_shell_accuracy(*shell, NULL), VPS_ERROR_ARGUMENT, "out is null");

  vps_voxmap_info about;
  vps_shell_info points;
  EXPECT(vps_voxmap_describe(*voxmap, &about) == VPS_OK && fabs(about.voxel_size_m - 0.5e-3) < 1e-9 && about.heap_bytes > 0);
  EXPECT(vps_shell_describe(*shell, &points) == VPS_OK && points.n_points > 1000 && points.mass.volume_m3 > 4e-6);

  // 1 mm over the middle of the upper face, and as far below it.
  double distance_m, gradient[3];
  EXPECT(vps_voxmap_distance(*voxmap, (double[]){0, 0, 21e-3}, &distance_m, gradient) == VPS_OK);
  EXPECT(fabs(distance_m - 1e-3) < 1e-5 && fabs(gradient[2] - 1) < 1e-3);
  EXPECT(vps_voxmap_distance(*voxmap, (double[]){0, 0, 19e-3}, &distance_m, NULL) == VPS_OK && fabs(distance_m + 1e-3) < 1e-5);
  EXPECT(vps_voxmap_distance(*voxmap, (double[]){0, 0, 1}, NULL, gradient) == VPS_OK && gradient[2] == 0);
  REFUSED(vps_voxmap_distance(*voxmap, (double[]){0, INFINITY, 0}, &distance_m, NULL), VPS_ERROR_ARGUMENT, "a coordinate of the point is inf");

  // What was saved is the same after it was loaded.
  char voxmap_file[512], shell_file[512];
  snprintf(voxmap_file, sizeof voxmap_file, "%s/voxmap", folder);
  snprintf(shell_file, sizeof shell_file, "%s/shell", folder);
  EXPECT(vps_voxmap_save(*voxmap, voxmap_file) == VPS_OK && vps_shell_save(*shell, shell_file) == VPS_OK);
  vps_voxmap_free(*voxmap);
  vps_shell_free(*shell);
  REFUSED(vps_voxmap_load(shell_file, voxmap), VPS_ERROR_FILE, "holds no voxmap");
  REFUSED(vps_shell_load("no/such/file", shell), VPS_ERROR_FILE, "no/such/file: cannot be read");
  EXPECT(*voxmap == NULL && *shell == NULL);
  EXPECT(vps_voxmap_load(voxmap_file, voxmap) == VPS_OK && vps_shell_load(shell_file, shell) == VPS_OK);
  REFUSED(vps_voxmap_save(*voxmap, "no/such/folder/file"), VPS_ERROR_FILE, "cannot be written");
}

static void queries(vps_query *query) {
  for (int n = 0; n < POSES; ++n) {
    const double half_turn = 0.01 * n, way = 28e-3 + 4e-3 * sin(0.3 * n);
    poses[n] = (vps_pose){{2e-3 * cos(n), 2e-3 * sin(n), way}, {0, sin(half_turn), 0, cos(half_turn)}};
  }
  int touching = 0;
  vps_contact *contacts = malloc(10000 * sizeof *contacts);
  for (int n = 0; n < POSES; ++n) {
    EXPECT(vps_query_contacts(query, &poses[n], contacts, 10000, &alone[n]) == VPS_OK && alone[n].n_contacts < 10000);
    double force_n = 0;
    for (size_t k = 0; k < alone[n].n_contacts; ++k) {
      EXPECT(contacts[k].depth_m > 0);
      force_n += contacts[k].force_n[2];
    }
    EXPECT(fabs(force_n - alone[n].force_n[2]) <= 1e-5 * fabs(force_n));
    EXPECT((alone[n].n_contacts == 0) == (alone[n].penetration_m == 0));
    touching += alone[n].n_contacts > 0;
  }
  EXPECT(touching > 100 && touching < 450);
  // No more than there is room for.
  int deep = 0;
  while (alone[deep].n_contacts < 3) ++deep;
  contacts[1].point = 12345678;
  vps_wrench felt;
  EXPECT(vps_query_contacts(query, &poses[deep], contacts, 1, &felt) == VPS_OK);
  EXPECT(felt.n_contacts == alone[deep].n_contacts && contacts[1].point == 12345678);
  EXPECT(vps_query_contacts(query, &poses[deep], NULL, 0, &felt) == VPS_OK);
  free(contacts);

  // Deeper by a micrometre pushes harder by the stiffness times that.
  vps_stiffness stiffness;
  EXPECT(vps_query_stiffness(query, &poses[deep], &stiffness) == VPS_OK);
  vps_pose deeper = poses[deep];
  deeper.position_m[2] -= 1e-6;
  vps_wrench harder;
  EXPECT(vps_query_wrench(query, &deeper, &harder) == VPS_OK);
  const double more_n = harder.force_n[2] - felt.force_n[2];
  EXPECT(more_n > 0 && fabs(more_n - 1e-6 * stiffness.rows[2][2]) < 0.02 * more_n);

  static vps_wrench batch[POSES];
  EXPECT(vps_query_wrenches(query, poses, POSES, batch) == VPS_OK && memcmp(batch, alone, sizeof batch) == 0);
  EXPECT(vps_query_wrenches(query, NULL, 0, NULL) == VPS_OK);
  pthread_t threads[4];
  for (int n = 0; n < 4; ++n) EXPECT(pthread_create(&threads[n], NULL, ask_all, query) == 0);
  for (int n = 0; n < 4; ++n) EXPECT(pthread_join(threads[n], NULL) == 0);

  vps_pose wrong[2] = {poses[0], {{0, 0, 0}, {0, 0, 0, 0}}};
  REFUSED(vps_query_wrenches(query, wrong, 2, batch), VPS_ERROR_ARGUMENT, "pose 1: rotation");
  REFUSED(vps_query_wrenches(query, wrong, 2, NULL), VPS_ERROR_ARGUMENT, "out is null: give 2");
  wrong[0].position_m[1] = NAN;
  REFUSED(vps_query_wrench(query, &wrong[0], &felt), VPS_ERROR_ARGUMENT, "pose 0: translation");
  REFUSED(vps_query_stiffness(query, &wrong[0], &stiffness), VPS_ERROR_ARGUMENT, "pose 0: translation");
  REFUSED(vps_query_stiffness(query, &poses[0], NULL), VPS_ERROR_ARGUMENT, "out is null");
  REFUSED(vps_query_wrench(query, NULL, &felt), VPS_ERROR_ARGUMENT, "pose is null");
  REFUSED(vps_query_wrench(NULL, &poses[0], &felt), VPS_ERROR_ARGUMENT, "query is null");
  REFUSED(vps_query_wrench(query, &poses[0], NULL), VPS_ERROR_ARGUMENT, "out is null");
}

// Parts that change places feel the opposite, and both ways are half of each.
static void both_ways(const vps_mesh *block, const vps_mesh *ball) {
  vps_options coarse = vps_options_default(1e-3), fine = vps_options_default(0.8e-3);
  coarse.field = VPS_FIELD_SURFACE_POINT;
  vps_voxmap *fixed, *moving;
  vps_shell *fixed_points, *moving_points;
  EXPECT(vps_voxmap_bake(block, &coarse, NULL, NULL, &fixed) == VPS_OK && vps_voxmap_bake(ball, &fine, NULL, NULL, &moving) == VPS_OK);
  EXPECT(vps_shell_bake(block, &coarse, NULL, NULL, &fixed_points) == VPS_OK && vps_shell_bake(ball, &fine, NULL, NULL, &moving_points) == VPS_OK);
  vps_query *both, *there, *back;
  EXPECT(vps_query_new_both_ways(fixed, fixed_points, moving, moving_points, 1000.0, &both) == VPS_OK);
  EXPECT(vps_query_new(fixed, moving_points, 1000.0, &there) == VPS_OK);
  EXPECT(vps_query_new(moving, fixed_points, 1000.0 * 1.0 / 0.64, &back) == VPS_OK);
  int touching = 0;
  for (int n = 0; n < 200; ++n) {
    const vps_pose at = {{0.02 * cos(n), 0.02 * sin(n), 29e-3 + 1e-3 * sin(0.3 * n)}, {0, 0, 0, 1}};
    const vps_pose inverse = {{-at.position_m[0], -at.position_m[1], -at.position_m[2]}, {0, 0, 0, 1}};
    vps_wrench felt, one, other;
    EXPECT(vps_query_wrench(both, &at, &felt) == VPS_OK && vps_query_wrench(there, &at, &one) == VPS_OK);
    EXPECT(vps_query_wrench(back, &inverse, &other) == VPS_OK && felt.n_contacts == one.n_contacts + other.n_contacts);
    const double force_n = fabs(one.force_n[2]) + fabs(other.force_n[2]);
    for (int k = 0; k < 3; ++k) {
      const int i = (k + 1) % 3, j = (k + 2) % 3;
      EXPECT(fabs(felt.force_n[k] - 0.5 * (one.force_n[k] - other.force_n[k])) <= 1e-5 * force_n);
      // About the origin of the block there, of the ball here.
      const double moved_nm = other.torque_nm[k] - (at.position_m[i] * other.force_n[j] - at.position_m[j] * other.force_n[i]);
      EXPECT(fabs(felt.torque_nm[k] - 0.5 * (one.torque_nm[k] - moved_nm)) <= 1e-6 * force_n);
    }
    touching += felt.n_contacts > 0;
  }
  EXPECT(touching > 50 && touching < 200);
  vps_query_free(back);
  REFUSED(vps_query_new_both_ways(fixed, fixed_points, NULL, moving_points, 1.0, &back), VPS_ERROR_ARGUMENT, "own_voxmap is null");
  REFUSED(vps_query_set_field(both, 4), VPS_ERROR_ARGUMENT, "field is 4");
  REFUSED(vps_query_set_field(NULL, VPS_FIELD_LAYERS), VPS_ERROR_ARGUMENT, "query is null");
  // The ball is not baked for it.
  REFUSED(vps_query_set_field(both, VPS_FIELD_SURFACE_POINT), VPS_ERROR_ARGUMENT, "bake them for this field");
  vps_wrench felt, other;
  const vps_pose deep = {{0, 0, 28e-3}, {0, 0, 0, 1}};
  EXPECT(vps_query_wrench(there, &deep, &felt) == VPS_OK);
  double error_m, both_m;
  EXPECT(vps_query_error_m(there, &error_m) == VPS_OK && vps_query_error_m(both, &both_m) == VPS_OK);
  // The block rounds its edges off by up to half a voxel, and the ball leaves little out.
  EXPECT(error_m > 0.08e-3 && error_m < 1e-3 && both_m >= error_m);
  REFUSED(vps_query_error_m(there, NULL), VPS_ERROR_ARGUMENT, "out is null");
  for (uint32_t field = VPS_FIELD_LAYERS; field <= VPS_FIELD_OCTANT; ++field) {
    EXPECT(vps_query_set_field(there, field) == VPS_OK && vps_query_wrench(there, &deep, &other) == VPS_OK);
    EXPECT(vps_query_error_m(there, &error_m) == VPS_OK && isnan(error_m));
    EXPECT(other.force_n[2] != felt.force_n[2] && fabs(other.force_n[2] / felt.force_n[2] - 1) < 0.5);
  }
  vps_query_free(both);
  vps_query_free(there);
  vps_voxmap_free(fixed);
  vps_voxmap_free(moving);
  vps_shell_free(fixed_points);
  vps_shell_free(moving_points);
}

int main(int argc, char **argv) {
  if (argc != 2) return 2;
  EXPECT(vps_abi_version() == VPS_ABI_VERSION);
  meshes();
  vps_mesh *block = NULL, *ball = NULL;
  vps_voxmap *voxmap = NULL;
  vps_shell *shell = NULL;
  vps_query *query = NULL;
  EXPECT(vps_mesh_shape(VPS_BOX, (double[]){40e-3, 40e-3, 40e-3}, 1e-5, &block) == VPS_OK);
  EXPECT(vps_mesh_shape(VPS_SPHERE, (double[]){10e-3, NAN, NAN}, 1e-5, &ball) == VPS_OK);
  baked(block, &voxmap, &shell, ball, argv[1]);
  both_ways(block, ball);
  REFUSED(vps_query_new(voxmap, shell, -1.0, &query), VPS_ERROR_ARGUMENT, "stiffness_n_per_m is -1");
  REFUSED(vps_query_new(voxmap, NULL, 1.0, &query), VPS_ERROR_ARGUMENT, "shell is null");
  EXPECT(vps_query_new(voxmap, shell, 1000.0, &query) == VPS_OK);
  // The query keeps what it needs.
  vps_voxmap_free(voxmap);
  vps_shell_free(shell);
  vps_mesh_free(block);
  vps_mesh_free(ball);
  queries(query);
  vps_query_free(query);
  vps_query_free(NULL);
  puts("border: ok");
  return 0;
}
