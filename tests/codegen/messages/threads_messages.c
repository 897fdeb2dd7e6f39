/* One thread receives, another steps: each difference that is held belongs to one message. Exit status 1 if one does not. */
#include "arm1_node.h"

#include <pthread.h>
#include <stdio.h>

enum { MESSAGES = 300000 };

static arm1_node_t node;
static volatile int done;

/* y[1] = -y[0], and both follow from the number. */
static void *receiver(void *unused)
{
    (void)unused;
    for (uint32_t k = 1u; k <= MESSAGES; k++) {
        const float y = (float)(k % 64u) / 16.0f;
        const arms_message_t message = {{ARMS_DESIGN_0, ARMS_DESIGN_1}, 2u, k, 0u, {y, -y}};
        uint8_t bytes[ARMS_MESSAGE_BYTES];

        arms_pack(&message, bytes);
        if (arm1_receive(&node, bytes, ARMS_MESSAGE_BYTES) != ARMS_TAKEN) return &node;
    }
    done = 1;
    return NULL;
}

int main(void)
{
    const float y[2] = {0.0f, 0.0f};
    float u[1];
    pthread_t thread;
    void *failed = NULL;
    unsigned long taken = 0;

    if (arm1_node_init(&node) != ARM1_OK || pthread_create(&thread, NULL, receiver, NULL) != 0) return 2;
    while (!done) {
        (void)arm1_node_step(&node, 0u, y, u);
        taken += node.fresh;
        if (node.held[0][0] != -node.held[0][1]) return printf("torn\n"), 1;
        arm1_forget(&node, 0u); /* so that a message of the same instant is taken again */
    }
    (void)pthread_join(thread, &failed);
    printf("%lu taken\n", taken);
    return failed == NULL && taken > 0 ? 0 : 1;
}
