// The page begins: every part watches what it shows, then the server is asked for the session.

import {act, begin} from "./api.js";
import {beginDataImport} from "./data_import.js";
import {beginCards} from "./cards.js";
import {byId} from "./dom.js";
import {beginKeys} from "./keys.js";
import {beginResidual} from "./residual.js";
import {beginLook} from "./look.js";
import {beginCore, beginModel} from "./model.js";
import {beginPayoff} from "./payoff.js";
import {beginRecords} from "./records.js";
import {beginStaircase} from "./staircase.js";
import {beginStatus} from "./status.js";
import {beginTraces} from "./traces.js";
import {beginViews} from "./views.js";

beginLook();
beginStatus();
beginDataImport();
beginRecords();
beginTraces();
beginViews();
beginStaircase();
beginCards();
beginModel();
beginCore();
beginResidual();
beginPayoff();
beginKeys();
byId("rank").addEventListener("click", () => act("/api/rank"));
byId("unknown").addEventListener("click", () => act("/api/unknown"));
byId("settle").addEventListener("click", () => act("/api/settle"));
begin();
