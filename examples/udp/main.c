/*
 * Three arms, three processes, UDP on the loopback interface: do they agree?
 *
 *     consensus [loss [ticks [seed]]]        for instance: consensus 0.1 4000 1
 *
 * Exit status 0 if the disagreement falls by a factor of 1000, 1 if it does not, 2 if something went wrong.
 */
#include "node.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

enum { AGENTS = 3, STATES = 4 };
/* (39): 1 listens to 2, 2 to 3, 3 to 1 */
static const unsigned SOURCE[AGENTS] = {1, 2, 0};
static const unsigned LISTENER[AGENTS] = {2, 0, 1};
static const double START[AGENTS][STATES] = {{0.8, 0, 0.8, 0}, {-0.5, 0, -0.5, 0}, {0.2, 0, 0.2, 0}};
static int (*const RUN[AGENTS])(node_t *) = {node_arm1, node_arm2, node_arm3};
static const double FALL = 1000.0;

/* A socket on a port that the system chooses: two runs at a time never collide. */
static int open_socket(struct sockaddr_in *address)
{
    socklen_t size = sizeof *address;
    const int s = socket(AF_INET, SOCK_DGRAM, 0);

    *address = (struct sockaddr_in){.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    if (s < 0 || bind(s, (struct sockaddr *)address, size) != 0) return -1;
    return getsockname(s, (struct sockaddr *)address, &size) == 0 ? s : -1;
}

static int read_all(int file, void *target, size_t bytes)
{
    char *to = target;

    while (bytes > 0) {
        const ssize_t n = read(file, to, bytes);
        if (n <= 0) return 0;
        to += n;
        bytes -= (size_t)n;
    }
    return 1;
}

/* sqrt of the sum over all pairs of |x_i - x_j|^2 */
static double disagreement(double x[AGENTS][STATES])
{
    double sum = 0;

    for (int i = 0; i < AGENTS; i++) {
        for (int j = 0; j < i; j++) {
            for (int k = 0; k < STATES; k++) sum += (x[i][k] - x[j][k]) * (x[i][k] - x[j][k]);
        }
    }
    return sqrt(sum);
}

int main(int argc, char **argv)
{
    node_t node = {.loss = argc > 1 ? atof(argv[1]) : 0.0,
        .ticks = argc > 2 ? (unsigned)atoi(argv[2]) : 4000,
        .seed = argc > 3 ? (unsigned)atoi(argv[3]) : 1};
    struct sockaddr_in address[AGENTS];
    int sockets[AGENTS], reports[AGENTS], failed = 0;
    double first = 0, last = 0, largest = 0;

    for (int i = 0; i < AGENTS; i++) {
        sockets[i] = open_socket(&address[i]);
        if (sockets[i] < 0) return perror("socket"), 2;
    }
    fflush(NULL);
    for (unsigned i = 0; i < AGENTS; i++) {
        int ends[2];
        if (pipe(ends) != 0) return perror("pipe"), 2;
        const pid_t child = fork();
        if (child < 0) return perror("fork"), 2;
        if (child == 0) {
            close(ends[0]);
            node.socket = sockets[i];
            node.report = ends[1];
            node.agent = i;
            node.source = SOURCE[i];
            node.listener = address[LISTENER[i]];
            for (int k = 0; k < STATES; k++) node.x[k] = START[i][k];
            exit(RUN[i](&node));
        }
        close(ends[1]);
        reports[i] = ends[0];
    }
    for (unsigned tick = 0; tick < node.ticks; tick++) {
        double x[AGENTS][STATES];
        for (int i = 0; i < AGENTS; i++) {
            if (!read_all(reports[i], x[i], sizeof x[i])) return fprintf(stderr, "agent %d stopped\n", i + 1), 2;
        }
        last = disagreement(x);
        if (tick == 0) first = last;
        if (last > largest) largest = last;
    }
    for (int i = 0; i < AGENTS; i++) {
        int status = 0;
        if (wait(&status) < 0 || status != 0) failed = 1;
    }
    printf("{\"loss\": %g, \"ticks\": %u, \"disagreement_initial\": %.6g, \"disagreement_largest\": %.6g, "
           "\"disagreement_final\": %.6g}\n", node.loss, node.ticks, first, largest, last);
    if (failed) return 2;
    return last * FALL <= first ? 0 : 1;
}
