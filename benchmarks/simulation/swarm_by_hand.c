/*
 * The yardstick of swarm.py: the arms on a sparse graph as an engineer writes them for this one purpose, gains and model
 * as constants, states of an agent side by side, one parallel loop over the agents for each period. It computes what every
 * simulation needs, the states and the disagreement at each period; no indices, no energies.
 *
 *   swarm_by_hand GRAPH PERIODS SUBSTEPS OUT      (files of 64-bit integers and doubles: see main)
 */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { NX = 4, NC = 2, NY = 2 };
static const float A[NC][NC] = { GAIN_A }, B[NC][NY] = { GAIN_B }, Cc[NC] = { GAIN_C }, D[NY] = { GAIN_D };
static const double T = PERIOD;

typedef struct { double x[NX]; float c[NC]; } agent_t;

static void arm(const double x[NX], double u, double dx[NX])
{
    dx[0] = x[1];
    dx[1] = -48.6 * x[0] - 1.25 * x[1] + 48.6 * x[2] + 21.6 * u;
    dx[2] = x[3];
    dx[3] = 19.5 * x[0] - 19.5 * x[2] - 3.33 * sin(x[2]);
}

static void rk4(double x[NX], double u, double h)
{
    double k1[NX], k2[NX], k3[NX], k4[NX], at[NX];
    arm(x, u, k1);
    for (int j = 0; j < NX; j++) at[j] = x[j] + h / 2 * k1[j];
    arm(at, u, k2);
    for (int j = 0; j < NX; j++) at[j] = x[j] + h / 2 * k2[j];
    arm(at, u, k3);
    for (int j = 0; j < NX; j++) at[j] = x[j] + h * k3[j];
    arm(at, u, k4);
    for (int j = 0; j < NX; j++) x[j] += h / 6 * (k1[j] + k4[j] + 2 * (k2[j] + k3[j]));
}

static double seconds(clockid_t which)
{
    struct timespec now;
    clock_gettime(which, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void *take(FILE *file, size_t size, size_t count)
{
    void *room = malloc(size * count + 1);
    if (room == NULL || fread(room, size, count, file) != count) exit(3);
    return room;
}

int main(int argc, char **argv)
{
    if (argc != 5) return 2;
    FILE *file = fopen(argv[1], "rb");
    if (file == NULL) return 2;
    int64_t size[2];
    if (fread(size, sizeof(int64_t), 2, file) != 2) return 3;
    const int64_t N = size[0];
    const int64_t *first = take(file, sizeof(int64_t), (size_t)N + 1);
    const int32_t *source = take(file, sizeof(int32_t), (size_t)size[1]);
    const float *weight = take(file, sizeof(float), (size_t)size[1]);
    const double *start = take(file, sizeof(double), (size_t)(N * NX));
    fclose(file);
    const int periods = atoi(argv[2]), substeps = atoi(argv[3]);
    agent_t *agent = calloc((size_t)N, sizeof(agent_t));
    float (*y)[NY] = calloc((size_t)N, sizeof *y), (*next)[NY] = calloc((size_t)N, sizeof *next);
    double *apart = calloc((size_t)periods + 1, sizeof(double));
    if (agent == NULL || y == NULL || next == NULL || apart == NULL) return 4;
    double mean[NX] = { 0 };
    for (int64_t i = 0; i < N; i++) {
        for (int j = 0; j < NX; j++) {
            agent[i].x[j] = start[i * NX + j];
            mean[j] += start[i * NX + j] / (double)N;
        }
        for (int j = 0; j < NY; j++) y[i][j] = (float)agent[i].x[j];
    }
    const double wall = seconds(CLOCK_MONOTONIC), processor = seconds(CLOCK_PROCESS_CPUTIME_ID);
    for (int k = 0; k < periods; k++) {
        double s0 = 0, s1 = 0, s2 = 0, s3 = 0, total = 0;
#pragma omp parallel for schedule(static) reduction(+ : s0, s1, s2, s3, total)
        for (int64_t i = 0; i < N; i++) {
            agent_t *a = &agent[i];
            float r[NY] = { 0 }, c[NC];
            double e;
            for (int j = 0; j < NX; j++) {
                e = a->x[j] - mean[j];
                total += e * e;
            }
            for (int64_t n = first[i]; n < first[i + 1]; n++)
                for (int j = 0; j < NY; j++) r[j] += weight[n] * (y[i][j] - y[source[n]][j]);
            const float u = Cc[0] * a->c[0] + Cc[1] * a->c[1] + D[0] * r[0] + D[1] * r[1];
            for (int j = 0; j < NC; j++)
                c[j] = A[j][0] * a->c[0] + A[j][1] * a->c[1] + B[j][0] * r[0] + B[j][1] * r[1];
            for (int j = 0; j < NC; j++) a->c[j] = c[j];
            for (int j = 0; j < substeps; j++) rk4(a->x, (double)u, T / substeps);
            for (int j = 0; j < NY; j++) next[i][j] = (float)a->x[j];
            s0 += a->x[0] - mean[0];
            s1 += a->x[1] - mean[1];
            s2 += a->x[2] - mean[2];
            s3 += a->x[3] - mean[3];
        }
        apart[k] = sqrt(total);
        mean[0] += s0 / (double)N;
        mean[1] += s1 / (double)N;
        mean[2] += s2 / (double)N;
        mean[3] += s3 / (double)N;
        float (*swap)[NY] = y;
        y = next;
        next = swap;
    }
    printf("%.6f %.6f\n", seconds(CLOCK_MONOTONIC) - wall, seconds(CLOCK_PROCESS_CPUTIME_ID) - processor);
    file = fopen(argv[4], "wb");
    if (file == NULL) return 5;
    fwrite(apart, sizeof(double), (size_t)periods, file);
    for (int64_t i = 0; i < N; i++) fwrite(agent[i].x, sizeof(double), NX, file);
    return fclose(file) == 0 ? 0 : 6;
}
