// Voxmap-pointshell contact: two meshes in, the wrench of a pose out. Made by cbindgen from crates/capi/src; its README.md has examples.
//
// SI units: metres, newtons, radians. Every call that can fail returns a vps_status and writes its result through its last arguments; of a call
// that failed, vps_last_error() says what is wrong, where, and what to do. Handles may be shared between threads; only vps_*_free wants its handle
// for itself, and takes NULL. Arrays are read or written during the call alone.

#ifndef VPS_H
#define VPS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Counts up with every change after which a program has to be compiled anew; also the number in
// the name libvps.so.1.
#define VPS_ABI_VERSION 1

// How a call ended. Later versions may have more.
typedef enum vps_status {
  // As asked.
  VPS_OK = 0,
  // An argument is null, or a value that its parameter does not allow.
  VPS_ERROR_ARGUMENT = 1,
  // A mesh file or arrays that are no mesh.
  VPS_ERROR_MESH = 2,
  // More voxels than one map or the memory holds.
  VPS_ERROR_GRID = 3,
  // A file of a baked part that cannot be read or written.
  VPS_ERROR_FILE = 4,
  // The callback for progress ended the bake.
  VPS_ERROR_CANCELLED = 5,
  // A mistake of this library; please report it.
  VPS_ERROR_INTERNAL = 6,
} vps_status;

// A stage of a bake. Later versions may have more.
typedef enum vps_stage {
  // Reading a file.
  VPS_STAGE_LOAD = 0,
  // Finding the voxels that the surface touches.
  VPS_STAGE_SURFACE = 1,
  // Telling inside from outside.
  VPS_STAGE_FILL = 2,
  // Growing layers around the surface.
  VPS_STAGE_LAYERS = 3,
  // Measuring distances.
  VPS_STAGE_DISTANCE = 4,
  // Placing points on the surface.
  VPS_STAGE_POINTS = 5,
  // Preparing distances for queries.
  VPS_STAGE_FIELD = 6,
  // Measuring what was baked.
  VPS_STAGE_REPORT = 7,
} vps_stage;

// A shape around the origin, its axis z, and what its sizes_m are.
typedef enum vps_shape {
  // Edges along x, y and z.
  VPS_BOX = 0,
  // Radius.
  VPS_SPHERE = 1,
  // Radius and height.
  VPS_CYLINDER = 2,
  // Radius of the base and height, apex at +z.
  VPS_CONE = 3,
  // Radius, and height without the caps.
  VPS_CAPSULE = 4,
  // Radius of the centre line, and of the tube.
  VPS_TORUS = 5,
} vps_shape;

// How to tell inside from outside.
typedef enum vps_inside_test {
  // By a fill from outside; where the mesh leaks, by winding numbers or as a thin skin.
  VPS_INSIDE_AUTO = 0,
  // By the fill alone.
  VPS_INSIDE_FLOOD = 1,
  // Holes get lids where the winding number is one half.
  VPS_INSIDE_WINDING = 2,
  // A thin skin with two sides.
  VPS_INSIDE_THIN = 3,
} vps_inside_test;

// How the depth of a point is found, as rendering.field of a scene.
typedef enum vps_field {
  // By interpolation of distances.
  VPS_FIELD_TRILINEAR = 0,
  // By the layer of the voxel and the plane of the point.
  VPS_FIELD_LAYERS = 1,
  // By the plane at the nearest point of the surface; takes two and a half times the memory.
  VPS_FIELD_SURFACE_POINT = 2,
  // By the distances around an octant of the voxel.
  VPS_FIELD_OCTANT = 3,
} vps_field;

// Which points a shell has, as tool.points of a scene.
typedef enum vps_points {
  // One for each facet of the surface in a voxel.
  VPS_POINTS_FACETS = 0,
  // One for each voxel of the surface, all alike.
  VPS_POINTS_VOXELS = 1,
} vps_points;

// Triangles of a part, ready to be baked.
typedef struct vps_mesh vps_mesh;

// Asks what wrench voxmaps exert on a shell. Any number of threads may ask one query at a time.
typedef struct vps_query vps_query;

// The part that touches: points on its surface.
typedef struct vps_shell vps_shell;

// The part that is touched: signed distances around its surface.
typedef struct vps_voxmap vps_voxmap;

// How to bake. Begin with vps_options_default, so that later members have their values.
typedef struct vps_options {
  // Edge of a voxel, m.
  double voxel_size_m;
  // Layers of voxels on each side of the surface in which distances are known, 2 to 126.
  uint32_t layers;
  // A vps_inside_test.
  uint32_t inside_test;
  // A vps_field: of the queries that a voxmap is baked for.
  uint32_t field;
  // A vps_points: which points a shell has.
  uint32_t points;
} vps_options;

// Hears of each stage before it begins, on the thread that bakes; anything but 0 ends the bake
// there with VPS_ERROR_CANCELLED. It must return: no exception, no longjmp.
typedef int (*vps_progress)(enum vps_stage stage, void *user);

// What a voxmap is like.
typedef struct vps_voxmap_info {
  // Edge of a voxel, m.
  double voxel_size_m;
  // How far outside the surface distances are known, m.
  double band_m;
  // Size of its arrays, bytes.
  size_t heap_bytes;
} vps_voxmap_info;

// What a bake measured; NaN: not measured of this kind of part.
typedef struct vps_accuracy {
  // Largest error of the stored distances that were measured again, m; of a voxmap.
  double sample_error_m;
  // How far off the surface is felt, m, largest at edges; of a voxmap.
  double surface_error_m;
  // How deep a flat face is entered before a point touches, m; of a shell.
  double unseen_depth_m;
  // Thinnest wall found, m.
  double thinnest_wall_m;
  // Smallest angle of material between two faces, degrees.
  double sharpest_edge_deg;
} vps_accuracy;

// A part of even density, in the mesh frame.
typedef struct vps_mass {
  // m³; 0 of a mesh that bounds no volume, whose mass lies on its surface.
  double volume_m3;
  // Centre of mass, m.
  double center_m[3];
  // Inertia about the centre of mass per kilogram, m², symmetric, row by row.
  double inertia_m2[9];
} vps_mass;

// What a shell is like.
typedef struct vps_shell_info {
  // Number of points; 0: it touches nothing.
  size_t n_points;
  // Spacing of the points, m.
  double voxel_size_m;
  // The part, in its mesh frame.
  struct vps_mass mass;
  // Size of its arrays, bytes.
  size_t heap_bytes;
} vps_shell_info;

// What the triangles of a mesh were taken for.
typedef struct vps_solid {
  // Connected pieces.
  size_t n_pieces;
  // Closed pieces that are material inside; their union, without the cavities, is the solid.
  size_t n_bodies;
  // Closed pieces that face inward inside of bodies and are empty.
  size_t n_cavities;
  // What these enclose together, m³.
  double cavities_m3;
  // Pieces that are not closed.
  size_t n_open_pieces;
  // Area of these, m².
  double open_area_m2;
} vps_solid;

// Where a mesh frame is in another: the shell's in the *world*, which is the voxmap's mesh frame, or
// of a query of several parts the frame in which these stand.
typedef struct vps_pose {
  // m.
  double position_m[3];
  // Unit quaternion x, y, z, w.
  double rotation_xyzw[4];
} vps_pose;

// What a shell feels at one pose; vectors in axes of the world.
typedef struct vps_wrench {
  // Force on the shell, N.
  double force_n[3];
  // Torque about the origin of the shell's mesh frame, N m.
  double torque_nm[3];
  // Depth of the deepest contact, m; 0 without one.
  double penetration_m;
  // Distance of the nearest point, m; 0 in contact, and never more than the least band of the
  // voxmaps.
  double clearance_m;
  // Number of points in contact.
  size_t n_contacts;
} vps_wrench;

// One point in contact; vectors in axes of the world.
typedef struct vps_contact {
  // Where its force acts, m.
  double position_m[3];
  // Unit direction that pushes the shell out: its own surface's normal, inward.
  double normal[3];
  // Unit gradient of the voxmap's distance there, the quickest way out: a motion of the contact
  // by v changes its depth by -v . gradient, that of a facet whose middle is outside by less.
  // Beyond the band it may be zero.
  double gradient[3];
  // Force of this contact on the shell, N; 0 of probes on edges and corners.
  double force_n[3];
  // m, greater than 0: of the point, or in the mean over a facet whose middle is outside.
  double depth_m;
  // Surface that it stands for, m²; 0 of probes.
  double area_m2;
  // Number of the voxmap.
  size_t part;
  // Number of the point in the shell.
  size_t point;
} vps_contact;

// How stiff a contact is: the second derivative of its energy by x, translations (m) and a
// rotation vector (rad) about the origin of the shell's mesh frame, world axes.
typedef struct vps_stiffness {
  // Symmetric: -d force/dx, N/m and N, and -d torque/dx, N and N m, whose part by turns is taken
  // symmetric.
  double rows[6][6];
} vps_stiffness;

// The point of a shell that is nearest to a part while nothing touches; world frame.
typedef struct vps_nearest {
  // False where something touches, and beyond the least band less a voxel: all else is then 0.
  bool is_known;
  // Number of the voxmap.
  size_t part;
  // Number of the point in the shell.
  size_t point;
  // The point, m.
  double on_shell_m[3];
  // The place on the surface of the part that is nearest to it, m: by interpolated distances.
  double on_part_m[3];
  // The clearance, m.
  double distance_m;
} vps_nearest;

// Contacts with one part whose gradients are within 20°; world frame.
typedef struct vps_patch {
  // Mean unit gradient of the distance, by force: the quickest way out.
  double normal[3];
  // Force on the shell, N.
  double force_n[3];
  // Mean place of the forces, by their size, m.
  double position_m[3];
  // Surface of the facets that touch, be it in part, m².
  double area_m2;
  // Of the deepest, m.
  double depth_m;
  // Number of the voxmap.
  size_t part;
  // How many.
  size_t n_contacts;
} vps_patch;

// Where a motion first touches.
typedef struct vps_impact {
  // False where it does not.
  bool touches;
  // Share of the motion, 0 to 1; 1 where it does not touch.
  double share;
  // Pose there: it touches, and a motion by the tolerance before it did not, where it does not
  // begin in contact. The end of a motion that does not touch.
  struct vps_pose pose;
} vps_impact;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// VPS_ABI_VERSION of the library that runs; that of the header is the one that the program was
// compiled with. They have to be equal.
uint32_t vps_abi_version(void);

// Voxels of this edge, m, and for the rest what suits most parts.
struct vps_options vps_options_default(double voxel_size_m);

// Share of a bake that is over when a stage begins, 0 to 1: the mean of some parts.
double vps_stage_share(uint32_t stage);

// Bakes the part that is touched, on all processors (RAYON_NUM_THREADS in the environment: on so
// many threads), to the same bits for any number of threads. progress may be null.
//
// # Safety
// `progress` may be called with `user`.
enum vps_status vps_voxmap_bake(const struct vps_mesh *mesh,
                                const struct vps_options *options,
                                vps_progress progress,
                                void *user,
                                struct vps_voxmap **out);

// Reads a file of vps_voxmap_save. It is checked as a whole; one that is damaged or of another
// format is refused.
//
// # Safety
// `file_name`: null, or ends with a zero byte.
enum vps_status vps_voxmap_load(const char *file_name, struct vps_voxmap **out);

// Writes a file that appears whole or not at all; vps_voxmap_load gives the same bits.
//
// # Safety
// `file_name`: null, or ends with a zero byte.
enum vps_status vps_voxmap_save(const struct vps_voxmap *voxmap, const char *file_name);

// Distance of a point of the mesh frame to the surface, m: greater than 0 outside, less than 0
// inside, never beyond band_m on either side. Its gradient points away from the surface outside
// and to it inside; 0 beyond the band. Either place may be null. Allocates nothing.
//
// # Safety
// `point_m` has three elements, and `gradient` room for three, or is null.
enum vps_status vps_voxmap_distance(const struct vps_voxmap *voxmap, const double *point_m, double *distance_m, double *gradient);

// What a voxmap is like.
enum vps_status vps_voxmap_describe(const struct vps_voxmap *voxmap, struct vps_voxmap_info *out);

// What the bake of a voxmap measured.
enum vps_status vps_voxmap_accuracy(const struct vps_voxmap *voxmap, struct vps_accuracy *out);

// What a user should know of the bake, a line each: holes, leaks, skins thinner than a voxel.
// Lives as long as the voxmap.
const char *vps_voxmap_warnings(const struct vps_voxmap *voxmap);

// Frees a voxmap; queries that were made of it stay.
//
// # Safety
// Null, or a voxmap that nothing uses any more.
void vps_voxmap_free(struct vps_voxmap *voxmap);

// Bakes the part that touches; as vps_voxmap_bake.
//
// # Safety
// `progress` may be called with `user`.
enum vps_status vps_shell_bake(const struct vps_mesh *mesh,
                               const struct vps_options *options,
                               vps_progress progress,
                               void *user,
                               struct vps_shell **out);

// Reads a file of vps_shell_save; as vps_voxmap_load.
//
// # Safety
// `file_name`: null, or ends with a zero byte.
enum vps_status vps_shell_load(const char *file_name, struct vps_shell **out);

// Writes a file; as vps_voxmap_save.
//
// # Safety
// `file_name`: null, or ends with a zero byte.
enum vps_status vps_shell_save(const struct vps_shell *shell, const char *file_name);

// What a shell is like.
enum vps_status vps_shell_describe(const struct vps_shell *shell, struct vps_shell_info *out);

// What the bake of a shell measured.
enum vps_status vps_shell_accuracy(const struct vps_shell *shell, struct vps_accuracy *out);

// As vps_voxmap_warnings.
const char *vps_shell_warnings(const struct vps_shell *shell);

// Frees a shell; queries that were made of it stay.
//
// # Safety
// Null, or a shell that nothing uses any more.
void vps_shell_free(struct vps_shell *shell);

// Text of the last call of this thread that failed: what is wrong, where, and what to do, in
// UTF-8; empty before. It stays until the next call of this thread that fails.
const char *vps_last_error(void);

// Reads an OBJ, STL, PLY, glTF or 3MF file whose numbers count metres_per_unit: 0.001 for
// millimetres.
//
// # Safety
// `file_name`: null, or ends with a zero byte.
enum vps_status vps_mesh_load(const char *file_name, double metres_per_unit, struct vps_mesh **out);

// A mesh of vertices `[n_vertices][3]`, m, and triangles `[n_triangles][3]`, numbers of vertices
// from 0, counter-clockwise seen from outside.
//
// # Safety
// The arrays have so many elements.
enum vps_status vps_mesh_from_f64(const double *vertices_m,
                                  size_t n_vertices,
                                  const uint32_t *triangles,
                                  size_t n_triangles,
                                  struct vps_mesh **out);

// The same of vertices in single precision.
//
// # Safety
// The arrays have so many elements.
enum vps_status vps_mesh_from_f32(const float *vertices_m,
                                  size_t n_vertices,
                                  const uint32_t *triangles,
                                  size_t n_triangles,
                                  struct vps_mesh **out);

// A shape, its triangles no farther than tolerance_m from it: a twentieth of a voxel loses
// nothing. shape is a vps_shape; sizes_m has three elements, and those that the shape lacks may
// have any value.
//
// # Safety
// `sizes_m` has three elements.
enum vps_status vps_mesh_shape(int shape, const double *sizes_m, double tolerance_m, struct vps_mesh **out);

// Number of vertices and of triangles; either place may be null.
enum vps_status vps_mesh_counts(const struct vps_mesh *mesh, size_t *n_vertices, size_t *n_triangles);

// Lowest and highest corner of the box around the triangles, m.
//
// # Safety
// There is room for three numbers in each.
enum vps_status vps_mesh_bounds(const struct vps_mesh *mesh, double *low_m, double *high_m);

// Volume, centre of mass and inertia.
enum vps_status vps_mesh_mass(const struct vps_mesh *mesh, struct vps_mass *out);

// What the triangles of a mesh were taken for.
enum vps_status vps_mesh_solid(const struct vps_mesh *mesh, struct vps_solid *out);

// What a user should look at, a line each; empty of a sound mesh. Lives as long as the mesh.
const char *vps_mesh_warnings(const struct vps_mesh *mesh);

// Frees a mesh; what was baked of it stays.
//
// # Safety
// Null, or a mesh that nothing uses any more.
void vps_mesh_free(struct vps_mesh *mesh);

// Prepares queries, which share the memory of both parts: these may be freed. stiffness_n_per_m is
// that of one point, which stands for a square of the shell's voxel edge s: a face of area A at
// depth d pushes with stiffness d A / s².
enum vps_status vps_query_new(const struct vps_voxmap *voxmap,
                              const struct vps_shell *shell,
                              double stiffness_n_per_m,
                              struct vps_query **out);

// The same of `n` voxmaps that stand in one world, each with the pose of its mesh frame there. Poses
// of the shell are then those in the world.
//
// # Safety
// There are `n` voxmaps and poses.
enum vps_status vps_query_new_of_parts(const struct vps_voxmap *const *voxmaps,
                                       const struct vps_pose *poses,
                                       size_t n,
                                       const struct vps_shell *shell,
                                       double stiffness_n_per_m,
                                       struct vps_query **out);

// The same of two parts that each have both, the one that stands still and the one that moves:
// half of the energy of the moving shell's points in the voxmap, and half of that of own_shell's
// points in own_voxmap. voxmap and own_shell are of the part that stands still, own_voxmap and
// shell of the one that moves. stiffness_n_per_m counts for a square of the moving shell's voxel
// edge, and by area for the other one. Contacts of own_shell's points have the part 1.
enum vps_status vps_query_new_both_ways(const struct vps_voxmap *voxmap,
                                        const struct vps_shell *own_shell,
                                        const struct vps_voxmap *own_voxmap,
                                        const struct vps_shell *shell,
                                        double stiffness_n_per_m,
                                        struct vps_query **out);

// Has a query find depths by a vps_field, before threads share it; voxmaps have to be baked for
// VPS_FIELD_SURFACE_POINT. With shells of the same vps_points the force is that of a scene.
enum vps_status vps_query_set_field(struct vps_query *query, uint32_t field);

// How far answers may be off, m: in at least 95 of 100 poses the penetration by no more than this,
// and the force by no more than this over the penetration as a share of it, at most all. NaN where
// that is not known: of skins, other fields than VPS_FIELD_TRILINEAR, other points than
// VPS_POINTS_FACETS.
enum vps_status vps_query_error_m(const struct vps_query *query, double *out);

// Wrench, penetration and clearance at a pose: the same bits on every thread. Allocates only where
// more threads ask at a time than ever before.
enum vps_status vps_query_wrench(const struct vps_query *query, const struct vps_pose *pose, struct vps_wrench *out);

// The same, and the contacts part by part in the order of the points: at most `capacity` of them;
// out->n_contacts says how many there are. Allocates as vps_query_wrench.
//
// # Safety
// There is room for `capacity` contacts.
enum vps_status vps_query_contacts(const struct vps_query *query,
                                   const struct vps_pose *pose,
                                   struct vps_contact *contacts,
                                   size_t capacity,
                                   struct vps_wrench *out);

// Stiffness at a pose; not always positive: convex contact pivots away. Allocates as
// vps_query_wrench.
enum vps_status vps_query_stiffness(const struct vps_query *query, const struct vps_pose *pose, struct vps_stiffness *out);

// The nearest point at a pose. Allocates as vps_query_wrench.
enum vps_status vps_query_nearest(const struct vps_query *query, const struct vps_pose *pose, struct vps_nearest *out);

// Patches at a pose, the hardest first: at most `capacity` of them; *n says how many there are.
// Allocates.
//
// # Safety
// There is room for `capacity` patches.
enum vps_status vps_query_patches(const struct vps_query *query,
                                  const struct vps_pose *pose,
                                  struct vps_patch *patches,
                                  size_t capacity,
                                  size_t *n);

// Where a motion first touches on which the shell's centre of mass goes straight and its rotation
// turns about one axis, both evenly. Parts may be thin: only contact that ends again within a way of
// tolerance_m may be missed. Allocates as vps_query_wrench.
enum vps_status vps_query_first_contact(const struct vps_query *query,
                                        const struct vps_pose *from,
                                        const struct vps_pose *to,
                                        double tolerance_m,
                                        struct vps_impact *out);

// The wrenches of n poses, on all processors: the same bits as one by one. Where a pose is none,
// nothing is written.
//
// # Safety
// There are `n` poses, and room for as many wrenches.
enum vps_status vps_query_wrenches(const struct vps_query *query, const struct vps_pose *poses, size_t n, struct vps_wrench *out);

// Frees a query.
//
// # Safety
// Null, or a query that nothing uses any more.
void vps_query_free(struct vps_query *query);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* VPS_H */
