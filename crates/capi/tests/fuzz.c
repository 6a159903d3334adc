// Random meshes, options, poses and files through the library: fuzz FOLDER SECONDS SEED[:ITERATION] SEEDS...
//
// An iteration depends on the seed and its number alone, so that SEED:ITERATION repeats it. Ends with 1 where a call says that the library itself
// failed, or answers with what cannot be; the sanitizer ends the rest. Files of calls that hang are left in the folder by the caller's time-out.
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <vps.h>

static uint64_t state, seed, iteration;
static const char *folder;
static uint64_t counts[7];

// SplitMix64.
static uint64_t next(void) {
  uint64_t z = (state += 0x9e3779b97f4a7c15u);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}
static size_t below(size_t n) { return n == 0 ? 0 : next() % n; }
static int one_in(size_t n) { return below(n) == 0; }
static double unit(void) { return (double)(next() >> 11) / 9007199254740992.0; }

static void wrong(const char *what) {
  fprintf(stderr, "%s: %s; repeat: SEED %" PRIu64 ":%" PRIu64 "\n", what, vps_last_error(), seed, iteration);
  exit(1);
}

static int ok(vps_status status) {
  if ((unsigned)status > VPS_ERROR_CANCELLED) wrong("the library failed");
  if (status != VPS_OK && vps_last_error()[0] == 0) wrong("an error without a text");
  ++counts[status];
  return status == VPS_OK;
}

static double number(void) {
  static const double odd[] = {0.0,   -0.0,  1.0,    -1.0,  NAN,  INFINITY, -INFINITY, 1e-320, 1e308,
                               -1e308, 1e9,  1.1e9,  1e-9,  1e-30, 1e30,    0.5,       3e38,   0x1p-126};
  if (one_in(12)) return odd[below(sizeof odd / sizeof *odd)];
  if (one_in(20)) {
    const uint64_t bits = next();
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
  }
  return (unit() - 0.5) * 0.1;
}

typedef struct {
  unsigned char *bytes;
  size_t n;
} Bytes;

static Bytes read_file(const char *name) {
  Bytes read = {NULL, 0};
  FILE *file = fopen(name, "rb");
  if (file == NULL) return read;
  read.bytes = malloc(1 << 20);
  read.n = fread(read.bytes, 1, 1 << 20, file);
  fclose(file);
  return read;
}

static void write_file(const char *name, const unsigned char *bytes, size_t n) {
  FILE *file = fopen(name, "wb");
  if (file == NULL || fwrite(bytes, 1, n, file) != n || fclose(file) != 0) {
    perror(name);
    exit(2);
  }
}

// Changes bytes, and cuts, doubles or inserts runs of them. Returns the new length, at most `room`.
static size_t mutate(unsigned char *bytes, size_t n, size_t room) {
  static const char *const words[] = {"nan", "inf", "-1", "1e999", "4294967296", "\n", " ", "/", "f 1 2 3\n", "v 0 0 0\n", "facet", "end_header\n"};
  for (size_t changes = 1 + below(8); changes > 0; --changes) {
    const size_t at = below(n), run = 1 + below(16);
    switch (below(6)) {
      case 0:
        if (n > 0) bytes[at] ^= (unsigned char)(1u << below(8));
        break;
      case 1:
        if (n > 0) bytes[at] = (unsigned char)next();
        break;
      case 2:
        if (one_in(4)) n = at;
        break;
      case 3:
        if (n + run <= room && at + run <= n) {
          memmove(bytes + at + run, bytes + at, n - at);
          n += run;
        }
        break;
      case 4: {
        const char *word = words[below(sizeof words / sizeof *words)];
        const size_t length = strlen(word);
        if (at + length <= n) memcpy(bytes + at, word, length);
        break;
      }
      default:
        if (at + 8 <= n) {
          const uint64_t value = one_in(2) ? UINT64_MAX >> below(64) : next();
          memcpy(bytes + at, &value, one_in(2) ? 4 : 8);
        }
    }
  }
  return n;
}

static vps_mesh *mesh_of_file(char **seeds, int n_seeds) {
  static const char *const folders[] = {"/obj/", "/stl/", "/ply/", "/threemf/", "/gltf/"};
  static const char *const endings[] = {"obj", "stl", "ply", "3mf", "gltf", "glb"};
  const char *from = n_seeds > 0 ? seeds[below((size_t)n_seeds)] : "";
  Bytes bytes = read_file(from);
  bytes.bytes = realloc(bytes.bytes, bytes.n + 4096);
  bytes.n = mutate(bytes.bytes, bytes.n, bytes.n + 4096);
  size_t ending = below(6);
  if (!one_in(20)) {
    for (size_t n = 0; n < 5; ++n) ending = strstr(from, folders[n]) != NULL ? n : ending;
    if (ending == 4 && bytes.n > 0 && bytes.bytes[0] == 'g') ending = 5;
  }
  char name[512];
  snprintf(name, sizeof name, "%s/part.%s", folder, endings[ending]);
  write_file(name, bytes.bytes, bytes.n);
  free(bytes.bytes);
  vps_mesh *mesh = NULL;
  const int made = ok(vps_mesh_load(name, one_in(4) ? number() : 1e-3, &mesh));
  if (made != (mesh != NULL)) wrong("a status and its handle");
  return mesh;
}

static vps_mesh *mesh_of_arrays(void) {
  const size_t n_vertices = below(40), n_triangles = below(80);
  // Exactly so large, so that the sanitizer sees one element too many.
  double *vertices = malloc(n_vertices * 3 * sizeof *vertices + 1);
  float *floats = malloc(n_vertices * 3 * sizeof *floats + 1);
  uint32_t *triangles = malloc(n_triangles * 3 * sizeof *triangles + 1);
  const int sound = !one_in(4);
  for (size_t n = 0; n < n_vertices * 3; ++n) {
    vertices[n] = sound ? (unit() - 0.5) * 0.05 : number();
    floats[n] = (float)(fabs(vertices[n]) < 3e38 ? vertices[n] : INFINITY);
  }
  for (size_t n = 0; n < n_triangles * 3; ++n) triangles[n] = (uint32_t)(one_in(400) ? next() : below(n_vertices));
  vps_mesh *mesh = NULL;
  ok(one_in(2) ? vps_mesh_from_f64(vertices, n_vertices, triangles, n_triangles, &mesh)
               : vps_mesh_from_f32(floats, n_vertices, triangles, n_triangles, &mesh));
  free(vertices);
  free(floats);
  free(triangles);
  return mesh;
}

static vps_mesh *mesh_of_shape(void) {
  const double sizes_m[3] = {one_in(8) ? number() : 1e-3 + 0.03 * unit(), one_in(8) ? number() : 1e-3 + 0.03 * unit(), 1e-3 + 0.03 * unit()};
  // Finer than this is slow and says nothing new.
  const double tolerance_m = one_in(8) ? -fabs(number()) : 1e-4;
  vps_mesh *mesh = NULL;
  ok(vps_mesh_shape((int)below(8) - 1, sizes_m, tolerance_m, &mesh));
  return mesh;
}

static vps_options options_for(const vps_mesh *mesh) {
  double low_m[3], high_m[3], longest_m = 0;
  if (!ok(vps_mesh_bounds(mesh, low_m, high_m))) wrong("bounds");
  for (int n = 0; n < 3; ++n) longest_m = fmax(longest_m, high_m[n] - low_m[n]);
  vps_options options = vps_options_default(longest_m / (1.0 + 40.0 * unit()));
  if (one_in(10)) options.voxel_size_m = fmax(number(), longest_m / 60);
  if (one_in(20)) options.voxel_size_m = longest_m * 1e-6;
  options.layers = one_in(20) ? (uint32_t)next() : 2 + (uint32_t)below(one_in(10) ? 125 : 10);
  options.inside_test = one_in(20) ? (uint32_t)next() : (uint32_t)below(4);
  options.field = one_in(20) ? (uint32_t)next() : (uint32_t)below(4);
  options.points = one_in(20) ? (uint32_t)next() : (uint32_t)below(2);
  return options;
}

static int maybe_stop(vps_stage stage, void *user) { return (int)stage == *(int *)user; }

// Reads back what was saved, and what is left of it after some bytes changed.
static void damage(const char *name, int is_voxmap) {
  Bytes bytes = read_file(name);
  bytes.bytes = realloc(bytes.bytes, bytes.n + 64);
  bytes.n = mutate(bytes.bytes, bytes.n, bytes.n + 64);
  write_file(name, bytes.bytes, bytes.n);
  free(bytes.bytes);
  vps_voxmap *voxmap = NULL;
  vps_shell *shell = NULL;
  ok(is_voxmap ? vps_voxmap_load(name, &voxmap) : vps_shell_load(name, &shell));
  vps_voxmap_free(voxmap);
  vps_shell_free(shell);
}

static vps_pose pose(void) {
  vps_pose pose = {{number(), number(), number()}, {unit() - 0.5, unit() - 0.5, unit() - 0.5, unit() - 0.5}};
  double length = 0;
  for (int n = 0; n < 4; ++n) length += pose.rotation_xyzw[n] * pose.rotation_xyzw[n];
  for (int n = 0; n < 4 && !one_in(60); ++n) pose.rotation_xyzw[n] /= sqrt(length);
  if (one_in(20)) pose.rotation_xyzw[below(4)] = number();
  return pose;
}

static void expect_sound(const vps_wrench *felt) {
  int sound = felt->penetration_m >= 0 && felt->clearance_m >= 0 && isfinite(felt->clearance_m) && isfinite(felt->penetration_m);
  sound = sound && (felt->n_contacts > 0) == (felt->penetration_m > 0);
  for (int n = 0; n < 3; ++n) sound = sound && isfinite(felt->force_n[n]) && isfinite(felt->torque_nm[n]);
  if (!sound) wrong("a wrench that cannot be");
}

static void ask(const vps_voxmap *voxmap, const vps_shell *shell) {
  vps_query *query = NULL;
  const double stiffness_n_per_m = one_in(8) ? number() : 1000.0;
  if (!ok(one_in(3) ? vps_query_new_both_ways(voxmap, shell, voxmap, shell, stiffness_n_per_m, &query)
                    : vps_query_new(voxmap, shell, stiffness_n_per_m, &query))) {
    return;
  }
  if (one_in(4)) ok(vps_query_set_field(query, (uint32_t)below(5)));
  enum { N = 20 };
  vps_pose *poses = malloc(N * sizeof *poses);
  vps_wrench *felt = malloc(N * sizeof *felt), one;
  for (int n = 0; n < N; ++n) {
    poses[n] = pose();
    if (!ok(vps_query_wrench(query, &poses[n], &felt[n]))) {
      poses[n] = (vps_pose){{0, 0, 0}, {0, 0, 0, 1}};
      if (!ok(vps_query_wrench(query, &poses[n], &felt[n]))) wrong("the pose of no motion");
    }
    expect_sound(&felt[n]);
    vps_stiffness stiffness;
    if (!ok(vps_query_stiffness(query, &poses[n], &stiffness))) wrong("a stiffness");
    for (int k = 0; k < 36; ++k) {
      if (!isfinite(stiffness.rows[k / 6][k % 6])) wrong("a stiffness that cannot be");
    }
    const size_t capacity = below(50);
    vps_contact *contacts = malloc(capacity * sizeof *contacts + 1);
    if (!ok(vps_query_contacts(query, &poses[n], contacts, capacity, &one)) || memcmp(&one, &felt[n], sizeof one) != 0) wrong("contacts");
    free(contacts);
    const double point_m[3] = {number(), number(), number()};
    double distance_m, gradient[3];
    if (ok(vps_voxmap_distance(voxmap, point_m, &distance_m, gradient)) && !(isfinite(distance_m) && isfinite(gradient[0]))) wrong("a distance");
  }
  vps_wrench *batch = malloc(N * sizeof *batch);
  if (!ok(vps_query_wrenches(query, poses, N, batch)) || memcmp(batch, felt, N * sizeof *batch) != 0) wrong("a batch");
  free(batch);
  free(felt);
  free(poses);
  vps_query_free(query);
}

static void run(char **seeds, int n_seeds) {
  state = seed * 0x2545f4914f6cdd1du + iteration;
  vps_mesh *mesh = one_in(2) ? mesh_of_file(seeds, n_seeds) : one_in(2) ? mesh_of_arrays() : mesh_of_shape();
  if (mesh == NULL) return;
  vps_mass mass;
  size_t n_vertices, n_triangles;
  if (!ok(vps_mesh_mass(mesh, &mass)) || !ok(vps_mesh_counts(mesh, &n_vertices, &n_triangles))) wrong("a mesh that was made");
  if (strlen(vps_mesh_warnings(mesh)) > 100000) wrong("warnings");
  const vps_options options = options_for(mesh);
  int stop_at = one_in(10) ? (int)below(8) : -1;
  vps_voxmap *voxmap = NULL;
  vps_shell *shell = NULL;
  ok(vps_voxmap_bake(mesh, &options, maybe_stop, &stop_at, &voxmap));
  ok(vps_shell_bake(mesh, &options, maybe_stop, &stop_at, &shell));
  if (voxmap != NULL && shell != NULL) {
    ask(voxmap, shell);
    char name[512];
    snprintf(name, sizeof name, "%s/baked", folder);
    const int is_voxmap = one_in(2);
    if (one_in(4)) {
      if (!ok(is_voxmap ? vps_voxmap_save(voxmap, name) : vps_shell_save(shell, name))) wrong("a file");
      damage(name, is_voxmap);
    }
  }
  vps_shell_free(shell);
  vps_voxmap_free(voxmap);
  vps_mesh_free(mesh);
}

static double now_s(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

int main(int argc, char **argv) {
  if (argc < 4) return 2;
  folder = argv[1];
  const double start_s = now_s(), limit_s = strtod(argv[2], NULL);
  char *rest = NULL;
  seed = strtoull(argv[3], &rest, 10);
  if (*rest == ':') {
    iteration = strtoull(rest + 1, NULL, 10);
    run(argv + 4, argc - 4);
    return 0;
  }
  double slowest_s = 0;
  uint64_t slowest = 0;
  for (double before_s = start_s; before_s - start_s < limit_s; ++iteration) {
    run(argv + 4, argc - 4);
    const double after_s = now_s();
    if (after_s - before_s > slowest_s) {
      slowest_s = after_s - before_s;
      slowest = iteration;
    }
    before_s = after_s;
  }
  printf("fuzz-border: seed %" PRIu64 ", %" PRIu64 " iterations; calls: %" PRIu64 " as asked, refused: %" PRIu64 " arguments, %" PRIu64 " meshes, %" PRIu64
         " grids, %" PRIu64 " files, %" PRIu64 " cancelled; the slowest, %" PRIu64 ", took %.2f s\n",
         seed, iteration, counts[0], counts[1], counts[2], counts[3], counts[4], counts[5], slowest, slowest_s);
  return counts[0] > 0 ? 0 : 1;
}
