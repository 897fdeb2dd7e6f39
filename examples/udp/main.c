/*
 * Three arms, three processes with their controllers, and a bad network between them: do they agree?
 *
 *     consensus [loss [ticks [seed [kill]]]]        for instance: consensus 0.3 4000 1 1
 *
 * This process is the world: it simulates the arms, is the common clock, and gives each node its sensor's values. The messages
 * go by UDP on the loopback interface, through a relay that loses them with the given probability, delays them by up to two
 * ticks, each by its own number, repeats one in ten and flips a bit in one of fifty. With `kill` 1 the node of arm 1 is
 * killed after a quarter of the ticks and started anew 100 ticks later; meanwhile its arm has no voltage.
 *
 * Exit status 0 if the disagreement falls by a factor of 1000, 1 if it does not, 2 if something went wrong.
 */
#include "node.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

enum { STATES = 4, SUBSTEPS = 5, DEAD_TICKS = 100, RELAY = AGENTS, PROCESSES = AGENTS + 1 };
static const double PERIOD_S = 0.005, FALL = 1000.0;
static const uint32_t FIRST_INSTANT = 4294966296u; /* it passes 2^32 on the way */
static const double START[AGENTS][STATES] = {{0.8, 0, 0.8, 0}, {-0.5, 0, -0.5, 0}, {0.2, 0, 0.2, 0}};
static int (*const RUN[AGENTS])(const node_t *) = {node_arm1, node_arm2, node_arm3};

typedef struct {
    pid_t id; /* 0: not running */
    int to, from;
    unsigned refused;
} process_t;

static int sockets[PROCESSES];
static struct sockaddr_in address[PROCESSES];
static process_t processes[PROCESSES];

int read_all(int file, void *target, size_t bytes)
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

int write_all(int file, const void *source, size_t bytes)
{
    return write(file, source, bytes) == (ssize_t)bytes; /* less than a pipe takes at once */
}

/* (38): the arm with a flexible joint, u held over the tick. */
static void derivative(const double x[STATES], double u, double dx[STATES])
{
    dx[0] = x[1];
    dx[1] = -48.6 * x[0] - 1.25 * x[1] + 48.6 * x[2] + 21.6 * u;
    dx[2] = x[3];
    dx[3] = 19.5 * x[0] - 19.5 * x[2] - 3.33 * sin(x[2]);
}

/* One tick of an arm by the classical Runge-Kutta rule. */
static void arm(double x[STATES], double u)
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

/* A socket on a port that the system chooses: two runs at a time never collide. */
static int open_socket(struct sockaddr_in *at)
{
    socklen_t size = sizeof *at;
    const int s = socket(AF_INET, SOCK_DGRAM, 0);

    *at = (struct sockaddr_in){.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    if (s < 0 || bind(s, (struct sockaddr *)at, size) != 0) return -1;
    return getsockname(s, (struct sockaddr *)at, &size) == 0 ? s : -1;
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

/* Start a node, or the relay; its socket stays open here, so that another process can go on with it. */
static int start(int which, const network_t *network)
{
    process_t *self = &processes[which];
    int down[2], up[2];

    if (pipe(down) != 0 || pipe(up) != 0) return 0;
    fflush(NULL);
    self->id = fork();
    if (self->id < 0) return 0;
    if (self->id == 0) {
        const node_t node = {sockets[which], address[RELAY], down[0], up[1]};

        close(down[1]);
        close(up[0]);
        for (int k = 0; k < PROCESSES; k++) { /* so that a closed pipe is seen as closed */
            if (k != which && processes[k].id > 0) {
                close(processes[k].to);
                close(processes[k].from);
            }
        }
        exit(which == RELAY ? relay_run(sockets[RELAY], address, down[0], up[1], network) : RUN[which](&node));
    }
    close(down[0]);
    close(up[1]);
    self->to = down[1];
    self->from = up[0];
    return 1;
}

static int stop(int which, int killed)
{
    process_t *self = &processes[which];
    int status = 0;

    if (killed) (void)kill(self->id, SIGKILL);
    close(self->to);
    close(self->from);
    (void)waitpid(self->id, &status, 0);
    self->id = 0;
    return killed ? WIFSIGNALED(status) : status == 0;
}

/* Give one process a tick and wait for its answer. */
static int ask(int which, const tick_t *tick, answer_t *answer)
{
    process_t *self = &processes[which];

    return write_all(self->to, tick, sizeof *tick) && read_all(self->from, answer, sizeof *answer);
}

static int one_tick(unsigned tick, double x[AGENTS][STATES])
{
    tick_t now[AGENTS];
    answer_t answer = {0};

    for (uint32_t step = 0; step < 2; step++) {
        for (int i = 0; i < AGENTS; i++) {
            now[i] = (tick_t){FIRST_INSTANT + tick, step, {(float)x[i][0], (float)x[i][1]}};
            answer.u = 0.0f;
            if (processes[i].id > 0 && !ask(i, &now[i], &answer)) return fprintf(stderr, "agent %d stopped\n", i + 1), 0;
            if (step == 1) {
                if (processes[i].id > 0) processes[i].refused = answer.refused;
                now[i].y[0] = answer.u;
            }
        }
        if (step == 0 && !ask(RELAY, &now[0], &answer)) return fprintf(stderr, "the relay stopped\n"), 0;
    }
    for (int i = 0; i < AGENTS; i++) arm(x[i], (double)now[i].y[0]);
    return 1;
}

int main(int argc, char **argv)
{
    const network_t network = {.loss = argc > 1 ? atof(argv[1]) : 0.0,
        .twice = 0.1, .corrupt = 0.02, .late = 2, .seed = argc > 3 ? (unsigned)atoi(argv[3]) : 1};
    const unsigned ticks = argc > 2 ? (unsigned)atoi(argv[2]) : 4000;
    const int kills = argc > 4 && atoi(argv[4]) != 0;
    double x[AGENTS][STATES], first = 0, largest = 0, last = 0;
    int failed = 0;

    for (int i = 0; i < AGENTS; i++) {
        for (int k = 0; k < STATES; k++) x[i][k] = START[i][k];
    }
    (void)signal(SIGPIPE, SIG_IGN);
    for (int k = 0; k < PROCESSES; k++) {
        sockets[k] = open_socket(&address[k]);
        if (sockets[k] < 0) return perror("socket"), 2;
    }
    for (int k = 0; k < PROCESSES; k++) {
        if (!start(k, &network)) return perror("start"), 2;
    }
    first = disagreement(x);
    for (unsigned tick = 0; tick < ticks; tick++) {
        if (kills && tick == ticks / 4 && !stop(0, 1)) return fprintf(stderr, "agent 1 was not to be killed\n"), 2;
        if (kills && tick == ticks / 4 + DEAD_TICKS && !start(0, &network)) return perror("start"), 2;
        if (!one_tick(tick, x)) return 2;
        last = disagreement(x);
        if (!(last <= largest)) largest = last;
    }
    printf("{\"loss\": %g, \"ticks\": %u, \"killed\": %s, \"disagreement_initial\": %.6g, \"disagreement_largest\": %.6g, "
           "\"disagreement_final\": %.6g, \"refused\": [%u, %u, %u]}\n", network.loss, ticks, kills ? "true" : "false", first,
        largest, last, processes[0].refused, processes[1].refused, processes[2].refused);
    for (int k = 0; k < PROCESSES; k++) {
        if (!stop(k, 0)) failed = 1;
    }
    if (failed) return 2;
    return last * FALL <= first ? 0 : 1;
}
