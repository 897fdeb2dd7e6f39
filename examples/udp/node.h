/* One agent as one process: its plant, its generated controller, and its messages. */
#ifndef NODE_H
#define NODE_H

#include <netinet/in.h>

/* Everything a process is told when it starts. */
typedef struct {
    int socket;                  /* bound to this agent's port; messages come in and go out here */
    int report;                  /* pipe to the parent: the plant's state at every tick */
    unsigned agent;              /* this agent's number, from 0 */
    unsigned source;             /* the agent it listens to */
    struct sockaddr_in listener; /* where the agent sits that listens to this one */
    double x[4];                 /* initial state: theta_m, omega_m, theta_l, omega_l */
    unsigned ticks;              /* how long to run */
    double loss;                 /* probability that an incoming message is thrown away */
    unsigned seed;               /* of the losses */
} node_t;

/* Run one agent; 0 if it ran to its end. Each is node.c compiled with its own generated controller. */
int node_arm1(node_t *node);
int node_arm2(node_t *node);
int node_arm3(node_t *node);

#endif
