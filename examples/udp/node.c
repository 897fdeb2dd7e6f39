/*
 * One agent: at each tick it samples, sends, takes what has arrived, and steps its controller.
 * Compile it once per agent with -DAGENT=arm1 (arm2, arm3): the name prefixes the generated functions.
 *
 * The messages are those of the folder's messages/: bytes in a defined order, with the design's identity and a CRC. What is
 * corrupted, repeated, too old or from elsewhere is refused and counted there; differences are of readings of one instant.
 * While its neighbour is gone (stale) this node rests: what to do then is the application's to decide.
 */
#include "node.h"

#include <sys/socket.h>
#include <unistd.h>

#define PASTE(a, b) a##b
#define JOIN(a, b) PASTE(a, b)
#define TEXT(a) #a
#define HEADER_OF(a) TEXT(a##_node.h)
#define HEADER(a) HEADER_OF(a)
#include HEADER(AGENT)

#define OF_AGENT(suffix) JOIN(AGENT, suffix)

enum { OK = 0, CLIPPED = 8 }; /* good steps: of the header, whose names are the agent's in capitals */

int JOIN(node_, AGENT)(const node_t *node)
{
    static OF_AGENT(_node_t) self;
    uint8_t bytes[ARM_CONTROLLERS_MESSAGE_BYTES + 1];
    tick_t tick;

    if (OF_AGENT(_node_init)(&self) != 0) return 5;
    while (read_all(node->from_world, &tick, sizeof tick)) {
        answer_t answer = {0};

        if (tick.step == 0) {
            if (OF_AGENT(_send)(&self, tick.instant, tick.y, bytes) != 0) {
                (void)sendto(node->socket, bytes, ARM_CONTROLLERS_MESSAGE_BYTES, 0, (const struct sockaddr *)&node->relay,
                    sizeof node->relay);
            }
        } else {
            ssize_t length;

            while ((length = recv(node->socket, bytes, sizeof bytes, MSG_DONTWAIT)) >= 0) {
                (void)OF_AGENT(_receive)(&self, bytes, (uint32_t)length);
            }
            const int status = (int)OF_AGENT(_node_step)(&self, tick.instant, tick.y, &answer.u);

            if (status != OK && status != CLIPPED) return 4;
            if (self.stale != 0) {
                OF_AGENT(_node_reset)(&self);
                answer.u = 0.0f;
            }
            for (unsigned k = 0; k < ARM_CONTROLLERS_REFUSALS; k++) answer.refused += self.refused[k];
        }
        if (!write_all(node->to_world, &answer, sizeof answer)) return 2;
    }
    return 0;
}
