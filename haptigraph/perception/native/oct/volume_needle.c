/* How well bevelled cylinders explain where light stops in the A-scans of an OCT volume. */

#include "native.h"

#define POSE 13 /* doubles a pose: direction, point of the axis, face's normal, sharp end, radius */

typedef struct {
    double along[3], axis[3], face[3], tip[3], radius;
} Needle;

/* Write the height of the metal's upper side at an A-scan; return whether there is metal. */
static inline int upper_mm(const Needle *needle, double x, double z, double *height) {
    const double *along = needle->along, *axis = needle->axis, *face = needle->face, *tip = needle->tip;
    const double off_x = x - axis[0], off_z = z - axis[2];
    const double level = off_x * along[0] + off_z * along[2], cos2 = 1 - along[1] * along[1];
    const double root =
        (needle->radius * needle->radius - off_x * off_x - off_z * off_z) * cos2 + level * level;
    if (root <= 0) return 0;
    const double half = sqrt(root) / cos2, middle = axis[1] + level * along[1] / cos2;
    const double beyond = (x - tip[0]) * face[0] + (z - tip[2]) * face[2];
    *height = middle + half;
    if (beyond + (*height - tip[1]) * face[1] <= 0) return 1;
    if (face[1] <= 1e-6) return 0;
    *height = tip[1] - beyond / face[1];
    return *height > middle - half;
}

/* Write the evidence of all A-scans for each needle, averaged over positions across the beam.
   at: x, z and weight of each A-scan; stops: its evidence by row; beam: displacements x, z. */
EXPORT void needle_scores(const double *at, int scans, const float *stops, int rows, double axial_mm,
                          const double *poses, int count, const double *beam, int beams, double *scores) {
    const double last = rows - 1;
    for (int number = 0; number < count; number++) {
        const double *pose = poses + number * POSE;
        const Needle needle = {{pose[0], pose[1], pose[2]},
                               {pose[3], pose[4], pose[5]},
                               {pose[6], pose[7], pose[8]},
                               {pose[9], pose[10], pose[11]},
                               pose[12]};
        const double flat = sqrt(needle.along[0] * needle.along[0] + needle.along[2] * needle.along[2]);
        double total = 0, widest = needle.radius;
        for (int k = 0; k < beams; k++)
            widest = fmax(widest, needle.radius + fabs(beam[2 * k]) + fabs(beam[2 * k + 1]));
        for (int n = 0; n < scans; n++) {
            const double x = at[3 * n] - needle.axis[0], z = at[3 * n + 1] - needle.axis[2];
            if (fabs(z * needle.along[0] - x * needle.along[2]) > widest * flat) continue;
            const float *evidence = stops + (ptrdiff_t)n * rows;
            double sum = 0, height = 0;
            for (int k = 0; k < beams; k++) {
                if (!upper_mm(&needle, at[3 * n] + beam[2 * k], at[3 * n + 1] + beam[2 * k + 1], &height))
                    continue;
                double row = last / 2 - height / axial_mm;
                row = row > 0 ? (row < last ? row : last) : 0; /* a NaN becomes 0 */
                const int above = row < last - 1 ? (int)row : rows - 2;
                sum += evidence[above] + (row - above) * (evidence[above + 1] - evidence[above]);
            }
            total += sum * at[3 * n + 2];
        }
        scores[number] = total / beams;
    }
}
