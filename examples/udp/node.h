/* One agent as one process: its generated controller and its messages. The arm itself is the parent's. */
#ifndef NODE_H
#define NODE_H

#include <netinet/in.h>
#include <stdint.h>

enum { AGENTS = 3, OUTPUTS = 2 };

/* What a process is told when it starts. */
typedef struct {
    int socket;               /* bound to this agent's port; messages come in and go out here */
    struct sockaddr_in relay; /* where its messages go */
    int from_world;           /* pipe: ticks, and the sensor's values */
    int to_world;             /* pipe: the actuator's value, or that it is done */
} node_t;

/* Of the common clock: first all sample and send, then all receive and step. */
typedef struct {
    uint32_t instant;
    uint32_t step; /* 0: sample y and send; 1: step */
    float y[OUTPUTS];
} tick_t;

typedef struct {
    float u;
    uint32_t refused;
} answer_t;

/* Run one agent until its pipe is closed; 0 if all went well. Each is node.c compiled with its own generated controller. */
int node_arm1(const node_t *node);
int node_arm2(const node_t *node);
int node_arm3(const node_t *node);

/* What the network does to messages. */
typedef struct {
    double loss;    /* probability that a message is lost */
    double twice;   /* that it comes twice */
    double corrupt; /* that a bit of it is flipped */
    unsigned late;  /* it comes up to so many ticks late, each as many as chance says: they overtake each other */
    unsigned seed;
} network_t;

/* Pass messages on, at each tick of the pipe, until it is closed. */
int relay_run(int socket, const struct sockaddr_in agents[AGENTS], int from_world, int to_world, const network_t *network);

int read_all(int file, void *target, size_t bytes);
int write_all(int file, const void *source, size_t bytes);

#endif
