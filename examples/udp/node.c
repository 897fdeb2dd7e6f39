/*
 * One agent: every tick it sends its outputs to its listener, takes what its source sent, and steps its controller.
 * Compile it once per agent with -DAGENT=arm1 (arm2, arm3): the name prefixes the generated functions.
 *
 * A message sent at one tick is used at the next: the network costs one period. A tick is as long as it takes for
 * the source's message to arrive, so simulated time runs faster than real time. A message that does not arrive
 * within PATIENCE_MS, or that is thrown away on purpose, is a clear bit in the mask: the controller then uses the
 * last one it has. Both ends are the same machine here; between machines the floats need a byte order.
 */
#include "node.h"

#include <math.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define PASTE(a, b) a##b
#define JOIN(a, b) PASTE(a, b)
#define TEXT(a) #a
#define HEADER_OF(a) TEXT(a.h)
#include HEADER_OF(AGENT)

#define OF_AGENT(suffix) JOIN(AGENT, suffix)

enum { OUTPUTS = 2, STATES = 4, PATIENCE_MS = 250, GIVE_UP_AFTER = 20, SUBSTEPS = 5 };
static const double PERIOD_S = 0.005;

typedef struct {
    uint32_t sender;
    uint32_t tick;
    float y[OUTPUTS];
} message_t;

/* (38): the arm with a flexible joint, u held over the tick. */
static void derivative(const double x[STATES], double u, double dx[STATES])
{
    dx[0] = x[1];
    dx[1] = -48.6 * x[0] - 1.25 * x[1] + 48.6 * x[2] + 21.6 * u;
    dx[2] = x[3];
    dx[3] = 19.5 * x[0] - 19.5 * x[2] - 3.33 * sin(x[2]);
}

/* One tick of the plant by the classical Runge-Kutta rule. */
static void plant(double x[STATES], double u)
{
    const double h = PERIOD_S / SUBSTEPS;
    double k[4][STATES], z[STATES];

    for (int n = 0; n < SUBSTEPS; n++) {
        derivative(x, u, k[0]);
        for (int s = 1; s < 4; s++) {
            for (int i = 0; i < STATES; i++) z[i] = x[i] + (s < 3 ? h / 2 : h) * k[s - 1][i];
            derivative(z, u, k[s]);
        }
        for (int i = 0; i < STATES; i++) x[i] += h / 6 * (k[0][i] + 2 * k[1][i] + 2 * k[2][i] + k[3][i]);
    }
}

/* A uniform number in [0, 1): the same on every machine (a 32-bit linear congruence, its high bits). */
static double uniform(uint32_t *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    return (double)(*seed >> 8) / 16777216.0;
}

/* Wait for the source's message of one tick; older ones that come late are thrown away. 1: it is there. */
static int receive(const node_t *node, uint32_t tick, message_t *message)
{
    struct pollfd ready = {.fd = node->socket, .events = POLLIN};

    while (poll(&ready, 1, PATIENCE_MS) > 0) {
        if (recv(node->socket, message, sizeof *message, 0) != (ssize_t)sizeof *message) continue;
        if (message->sender == node->source && message->tick == tick) return 1;
    }
    return 0;
}

int JOIN(node_, AGENT)(node_t *node)
{
    OF_AGENT(_state_t) controller;
    uint32_t seed = node->seed * 2654435761u + node->agent;
    unsigned silent = 0;

    if (OF_AGENT(_init)(&controller) != 0) return 5;
    for (uint32_t tick = 0; tick < node->ticks; tick++) {
        message_t out = {node->agent, tick, {(float)node->x[0], (float)node->x[1]}};
        message_t in = {0};
        OF_AGENT(_mask_t) received = 0;
        float u[1];

        if (write(node->report, node->x, sizeof node->x) != (ssize_t)sizeof node->x) return 2;
        (void)sendto(node->socket, &out, sizeof out, 0, (struct sockaddr *)&node->listener, sizeof node->listener);
        if (tick > 0) {
            const int arrived = receive(node, tick - 1, &in);
            silent = arrived ? 0 : silent + 1;
            if (silent == GIVE_UP_AFTER) return 3;
            if (uniform(&seed) >= node->loss && arrived) received = 1;
        }
        if (OF_AGENT(_step)(&controller, out.y, in.y, received, u) != 0) return 4;
        plant(node->x, (double)u[0]);
    }
    fprintf(stderr, "agent %u: %lu of %u messages missing\n", node->agent + 1, (unsigned long)controller.misses[0], node->ticks);
    return 0;
}
