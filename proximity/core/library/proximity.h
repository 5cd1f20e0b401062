/* proximity: exact distances, rays and segments against the parts of a compiled scene. C99 and C++.

   A scene is a file "....prox", written by `proximity compile` or Python's `Scene.save`. Lengths are in
   metres, in the scene's frame; matrices are row-major, "scene from part". Answers equal those of the Python
   package, bit for bit.

   - Functions return PROXIMITY_OK or an error code; `error`, if not NULL, receives a message. Outputs are
   written
     only on success, unless stated otherwise.
   - NULL instead of a scene or a tracker is PROXIMITY_BAD_ARGUMENT, or a scene without parts.
   - The caller owns all arrays. Nothing is printed, and no state is kept outside of scenes.
   - Queries need 256 KiB of stack.
   - Threads: any number may query one scene at the same time. Opening, changing or closing a scene must not
     happen while another thread uses that scene; different scenes are independent. Each function is marked:
     it *reads*, or it *changes* a scene. */
#ifndef PROXIMITY_H
#define PROXIMITY_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(_WIN32) && !defined(PROXIMITY_STATIC)
#ifdef PROXIMITY_BUILDS
#define PROXIMITY_API __declspec(dllexport)
#else
#define PROXIMITY_API __declspec(dllimport)
#endif
#elif defined(__GNUC__)
#define PROXIMITY_API __attribute__((visibility("default")))
#else
#define PROXIMITY_API
#endif

/* Version of this interface: grows when a program compiled before would no longer run. */
#define PROXIMITY_INTERFACE 1

/* The interface version of the library, to compare with the macro. May be called at any time. */
PROXIMITY_API int proximity_interface(void);

/* The version of the library's package, as text. May be called at any time. */
PROXIMITY_API const char *proximity_version(void);

/* --- errors ------------------------------------------------------------------------------------------- */

enum {
    PROXIMITY_OK = 0,
    PROXIMITY_BAD_ARGUMENT = 1, /* an invalid argument */
    PROXIMITY_NO_MEMORY = 2,
    PROXIMITY_NO_FILE = 3,      /* a file cannot be opened or read */
    PROXIMITY_BAD_FILE = 4,     /* not a compiled scene, or a damaged one */
    PROXIMITY_BAD_POSE = 5,     /* not a rigid transform, or one that is too far away */
    PROXIMITY_NO_INSIDE = 6,    /* no part has an inside */
    PROXIMITY_NO_PROCESSOR = 7, /* this processor lacks instructions: AVX2 and FMA, or NEON */
    PROXIMITY_BROKEN = 8,       /* an earlier change of this scene failed: close it */
    PROXIMITY_BAD_VERSION = 9,  /* a compiled scene of another version: compile it again */
    PROXIMITY_BAD_MESH = 10     /* an invalid mesh: a face without its vertex, a vertex that is not finite */
};

typedef struct proximity_error {
    int32_t code;
    char sentence[508]; /* UTF-8: cause, place and expected value */
} proximity_error;

/* --- scenes ------------------------------------------------------------------------------------------- */

typedef struct proximity_scene proximity_scene;

/* Open a compiled scene. `path` is UTF-8. All checksums of the file are verified. The file must not be
   modified while the scene is open; it may be replaced. */
PROXIMITY_API int proximity_open(const char *path, proximity_scene **scene, proximity_error *error);

/* Open the bytes of such a file in memory. They remain the caller's, must be aligned to 8 bytes, and must not
   change until the scene is closed and its trackers are destroyed; the scene copies the bytes that it
   changes. */
PROXIMITY_API int proximity_open_bytes(const void *bytes, size_t size, proximity_scene **scene,
                                       proximity_error *error);

/* Close a scene: it is freed with its last tracker, or immediately. NULL is allowed. */
PROXIMITY_API void proximity_close(proximity_scene *scene);

/* Set the callback for notes on this scene and its trackers; NULL: none. A note is a sentence on suspicious
   input: points or positions in millimetres, instants of two clocks. Each kind is noted once, in the thread
   of the call that found it; `log` must not change the scene. *Changes.* */
typedef void proximity_log(void *user, const char *sentence);
PROXIMITY_API void proximity_set_log(proximity_scene *scene, proximity_log *log, void *user);

/* Choose the instruction set for queries of a scene by name ("v3", "v4", "neon"). Default: the best one of
   the processor. Answers do not depend on it. *Changes.* */
PROXIMITY_API int proximity_use_instructions(proximity_scene *scene, const char *name, proximity_error *error);

/* The name of that instruction set. *Reads.* */
PROXIMITY_API const char *proximity_instructions(const proximity_scene *scene);

/* --- parts: numbers from 0 to the count, as in answers ------------------------------------------------- */

#define PROXIMITY_NO_PART (-1)
#define PROXIMITY_NO_FACE (-1)

/* Number of parts. *Reads.* */
PROXIMITY_API int32_t proximity_part_count(const proximity_scene *scene);

/* The name of a part, UTF-8, valid while the scene is open; NULL if the part does not exist. *Reads.* */
PROXIMITY_API const char *proximity_part_name(const proximity_scene *scene, int32_t part);

/* The part of that name; PROXIMITY_NO_PART if there is none. *Reads.* */
PROXIMITY_API int32_t proximity_find_part(const proximity_scene *scene, const char *name);

/* The number of faces of a part; 0 if the part does not exist. *Reads.* */
PROXIMITY_API int32_t proximity_face_count(const proximity_scene *scene, int32_t part);

/* Test whether a part is hidden: 1 or 0. *Reads.* */
PROXIMITY_API int proximity_is_hidden(const proximity_scene *scene, int32_t part);

/* The pose of a part: 16 numbers. *Reads.* */
PROXIMITY_API int proximity_pose(const proximity_scene *scene, int32_t part, double *matrix,
                                 proximity_error *error);

/* Lower and upper corner of the smallest box around all parts, hidden ones too: 3 numbers each. *Reads.* */
PROXIMITY_API void proximity_bounds(const proximity_scene *scene, double *lower, double *upper);

/* Move `count` parts: `matrices` has 16 numbers for each; a rotation in single precision is replaced by the
   nearest exact one. `velocities` (m/s, of the parts' origins) and `angular_velocities` (rad/s, about them)
   have 3 each, or are NULL: at rest. If one part cannot be moved, none is. About 10 µs for 20 parts of 200;
   0.5 ms when a part moves for the first time. *Changes.* */
PROXIMITY_API int proximity_move(proximity_scene *scene, const int32_t *parts, size_t count,
                                 const double *matrices, const double *velocities,
                                 const double *angular_velocities, proximity_error *error);

/* Post the pose of a part from another thread than the one that ticks. Lock-free: the newest pose of each
   part is applied at the start of the next tick, or by proximity_take. One thread may post while another one
   ticks and queries the scene. `pose_ns` is the instant of the pose, on the clock of the fingers: the part
   moves on with its velocities (m/s and rad/s; NULL: at rest) to the newest instant of the fingers, and stops
   100 ms after `pose_ns`. The first call allocates memory. */
PROXIMITY_API int proximity_post(proximity_scene *scene, int32_t part, const double *matrix, int64_t pose_ns,
                                 const double *velocity, const double *angular_velocity, proximity_error *error);

/* Apply posted poses for an instant, in programs without a tracker. *Changes.* */
PROXIMITY_API int proximity_take(proximity_scene *scene, int64_t instant_ns, proximity_error *error);

/* Hide a part from queries and ticks (`is_hidden` not 0), or show it again. *Changes.* */
PROXIMITY_API int proximity_hide(proximity_scene *scene, int32_t part, int is_hidden, proximity_error *error);

/* Set how a part reacts to a touch, for a tracker's answers: stiffness in N/m, above 0, and damping in N s/m;
   both 0: rigid. Distances do not change. *Changes.* */
PROXIMITY_API int proximity_set_surface(proximity_scene *scene, int32_t part, double stiffness, double damping,
                                        proximity_error *error);

/* --- adding and removing parts --------------------------------------------------------------------------- */

/* Make an empty scene, to add parts to. Queries and ticks of a scene without parts are PROXIMITY_BAD_ARGUMENT. */
PROXIMITY_API int proximity_new_scene(proximity_scene **scene, proximity_error *error);

/* Make a scene of the bodies of a mesh, welded, split and signed as by Python's Scene.from_mesh: answers are
   equal, bit for bit. `vertices` has 3 numbers each (m), `faces` 3 vertex numbers each, counter-clockwise
   seen from outside. One body is the part `name`, several are `name`.1, `name`.2, ... It uses no other scene:
   a separate thread may make the scene (about 3 µs a face), and proximity_add_scene add its parts afterwards.
   */
PROXIMITY_API int proximity_from_mesh(const char *name, const double *vertices, size_t vertex_count, const int32_t *faces,
                                      size_t face_count, proximity_scene **scene, proximity_error *error);

/* Reason for the sign method of a part from a mesh: a sentence, UTF-8, valid until the scene is changed or
   closed. NULL for parts of a compiled scene, and if the part does not exist. *Reads.* */
PROXIMITY_API const char *proximity_sign_reason(const proximity_scene *scene, int32_t part);

/* Make a scene of a mesh and add it, at `matrix` (NULL: identity). *Changes.* */
PROXIMITY_API int proximity_add(proximity_scene *scene, const char *name, const double *vertices, size_t vertex_count,
                                const int32_t *faces, size_t face_count, const double *matrix, int32_t *first,
                                proximity_error *error);

/* Add copies of all parts of another scene, at `matrix` (NULL: identity) times their poses. Their names must
   be new. `first` (or NULL) receives the number of the first; the others follow, and numbers of earlier parts
   stay. Trackers keep their state. *Changes*; other threads may query `added`. */
PROXIMITY_API int proximity_add_scene(proximity_scene *scene, const proximity_scene *added, const double *matrix,
                                      int32_t *first, proximity_error *error);

/* Remove a part, which must not be the only one; the numbers of later parts decrease by one. *Changes.* */
PROXIMITY_API int proximity_remove(proximity_scene *scene, int32_t part, proximity_error *error);

/* --- queries: `points`, `origins`, `directions`, `starts`, `ends` have 3 numbers a row ------------------ */

enum { PROXIMITY_NONE = -1, PROXIMITY_FACE = 0, PROXIMITY_EDGE = 1, PROXIMITY_VERTEX = 2 };

typedef struct proximity_closest_point {
    double signed_distance; /* m, negative inside; infinite beyond the limit, nan for an invalid point */
    double point[3];        /* of the surface */
    double gradient[3];     /* unit: direction of steepest increase of signed_distance; 0 if undefined */
    double barycentric[3];  /* weights of the corners of the face */
    int32_t part, face;     /* or PROXIMITY_NO_PART, PROXIMITY_NO_FACE */
    int32_t feature;        /* of the face: PROXIMITY_FACE, ... */
    int32_t is_signed;      /* 0 if the part has no inside */
} proximity_closest_point;

typedef struct proximity_ray_hit {
    double distance; /* m along the ray; infinite without a hit within the limit */
    double point[3];
    double normal[3]; /* unit, outward */
    double barycentric[3];
    int32_t part, face;
} proximity_ray_hit;

typedef struct proximity_segment_hit {
    double distance;            /* m, unsigned; 0 if the segment meets the surface */
    double point_on_segment[3]; /* the ends of the shortest connection */
    double point_on_solid[3];
    double fraction; /* position on the segment: 0 at its start, 1 at its end */
    double barycentric[3];
    int32_t part, face;
} proximity_segment_hit;

/* The surface points nearest to points, no farther than `max_distance` (INFINITY: no limit). *Reads.* */
PROXIMITY_API int proximity_closest(const proximity_scene *scene, const double *points, size_t count,
                                    double max_distance, proximity_closest_point *answers,
                                    proximity_error *error);

/* Signed distances, m: as proximity_closest, and faster. *Reads.* */
PROXIMITY_API int proximity_signed_distance(const proximity_scene *scene, const double *points, size_t count,
                                            double *distances, proximity_error *error);

/* Distances to the nearest surface, m, without sign: the fastest query. *Reads.* */
PROXIMITY_API int proximity_distance(const proximity_scene *scene, const double *points, size_t count,
                                     double *distances, proximity_error *error);

/* Test whether points are inside some part: 1 or 0 each. *Reads.* */
PROXIMITY_API int proximity_contains(const proximity_scene *scene, const double *points, size_t count,
                                     uint8_t *is_inside, proximity_error *error);

/* The first hits of rays, no farther along them than `max_distance`. Directions have any length but zero: a
   zero direction is an error, and the answers of the other rays are written. *Reads.* */
PROXIMITY_API int proximity_cast(const proximity_scene *scene, const double *origins, const double *directions,
                                 size_t count, double max_distance, proximity_ray_hit *answers,
                                 proximity_error *error);

/* The distances of proximity_cast alone, faster. *Reads.* */
PROXIMITY_API int proximity_cast_distance(const proximity_scene *scene, const double *origins,
                                          const double *directions, size_t count, double max_distance,
                                          double *distances, proximity_error *error);

/* The shortest connections between segments and the surface, no longer than `max_distance`. *Reads.* */
PROXIMITY_API int proximity_closest_to_segments(const proximity_scene *scene, const double *starts,
                                                const double *ends, size_t count, double max_distance,
                                                proximity_segment_hit *answers, proximity_error *error);

/* --- the same without some parts: `ignored` has `ignored_count` numbers of parts that this call leaves out --
   Such as the part that a hand holds, where it is to measure the others. Answers are those of a scene in which these
   parts are hidden, bit for bit; the scene does not change, so that other threads may ask it with them. Each copies
   some 200 bytes a part. *Ask.* */

PROXIMITY_API int proximity_closest_without(const proximity_scene *scene, const double *points, size_t count,
                                            double max_distance, const int32_t *ignored, size_t ignored_count,
                                            proximity_closest_point *answers, proximity_error *error);
PROXIMITY_API int proximity_signed_distance_without(const proximity_scene *scene, const double *points, size_t count,
                                                    const int32_t *ignored, size_t ignored_count, double *distances,
                                                    proximity_error *error);
PROXIMITY_API int proximity_distance_without(const proximity_scene *scene, const double *points, size_t count,
                                             const int32_t *ignored, size_t ignored_count, double *distances,
                                             proximity_error *error);
PROXIMITY_API int proximity_contains_without(const proximity_scene *scene, const double *points, size_t count,
                                             const int32_t *ignored, size_t ignored_count, uint8_t *is_inside,
                                             proximity_error *error);
PROXIMITY_API int proximity_cast_without(const proximity_scene *scene, const double *origins, const double *directions,
                                         size_t count, double max_distance, const int32_t *ignored,
                                         size_t ignored_count, proximity_ray_hit *answers, proximity_error *error);
PROXIMITY_API int proximity_cast_distance_without(const proximity_scene *scene, const double *origins,
                                                  const double *directions, size_t count, double max_distance,
                                                  const int32_t *ignored, size_t ignored_count, double *distances,
                                                  proximity_error *error);
PROXIMITY_API int proximity_closest_to_segments_without(const proximity_scene *scene, const double *starts,
                                                        const double *ends, size_t count, double max_distance,
                                                        const int32_t *ignored, size_t ignored_count,
                                                        proximity_segment_hit *answers, proximity_error *error);

/* --- two parts ------------------------------------------------------------------------------------------ */

enum {
    PROXIMITY_APART = 0,
    PROXIMITY_TOUCHING = 1,     /* surfaces meet, within rounding; the parts have no common volume */
    PROXIMITY_CROSSING = 2,     /* surfaces meet, and the parts have a common volume */
    PROXIMITY_FIRST_INSIDE = 3, /* the first part, or one of its surfaces, is inside the second */
    PROXIMITY_SECOND_INSIDE = 4
};

typedef struct proximity_clearance_answer {
    double lower;             /* m: lower bound of the distance; equal to it unless the search ended early */
    double distance;          /* m; 0 unless the parts are apart; infinite beyond the limit */
    double point_on_first[3]; /* the ends of the shortest connection; nan if there is none; */
    double point_on_second[3]; /* one point of both if parts cross, or one is inside the other */
    int32_t face_on_first, face_on_second; /* or PROXIMITY_NO_FACE */
    int32_t relation;                      /* PROXIMITY_APART, ... */
    int32_t unused;
} proximity_clearance_answer;

/* The shortest connection of two parts, hidden or not, if it is shorter than `max_distance`. `tolerance`:
   share by which the distance returned may be longer. `budget`: largest number of boxes and groups of
   triangles examined; 0: no limit. If boxes of the parts meet, the call uses 8 bytes of memory a face.
   *Reads.* */
PROXIMITY_API int proximity_clearance(const proximity_scene *scene, int32_t first, int32_t second,
                                      double max_distance, double tolerance, size_t budget,
                                      proximity_clearance_answer *answer, proximity_error *error);

/* The nearest pairs of visible parts, no farther apart than `max_distance` (INFINITY: however far): at most `capacity`
   of them, the nearest first; `count` gets how many. If it is `capacity`, there may be more. `parts` gets two numbers a
   row, the lower one first, and `answers` what proximity_clearance gives. `part`: pairs of this part only, which may be
   hidden; PROXIMITY_NO_PART: of all. Memory of 16 bytes a pair of parts and 8 bytes a face is used meanwhile. *Asks.* */
PROXIMITY_API int proximity_closest_pairs(const proximity_scene *scene, int32_t part, double max_distance,
                                          size_t capacity, int32_t *parts, proximity_clearance_answer *answers,
                                          size_t *count, proximity_error *error);

typedef struct proximity_penetration_answer {
    double depth;            /* m, way out: moved so far along the direction, the first part is free of the second */
    double lower;            /* m: moved by less, it is not */
    double direction[3];     /* unit */
    double deepest;          /* m: no point of either part is farther inside the other */
    double deepest_lower;    /* m: the deepest point is at least so far inside */
    double deepest_point[3]; /* nan where the parts do not overlap; the depths are 0 then */
} proximity_penetration_answer;

/* How deep two parts are in each other, hidden or not: the way out of the first one, along `direction` (3 numbers; NULL:
   a direction with a short way), and the deepest point. `tolerance`: share by which the bounds of each may differ, such
   as 0.01. The volume in common (Python's `overlap`) needs a library of its own, manifold3d, and is not here. *Asks.* */
PROXIMITY_API int proximity_penetration(const proximity_scene *scene, int32_t first, int32_t second,
                                        const double *direction, double tolerance,
                                        proximity_penetration_answer *answer, proximity_error *error);

#ifdef __cplusplus
}
#endif

#endif
